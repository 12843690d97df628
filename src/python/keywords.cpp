#include "python/keywords.h"

#include <stdexcept>
#include <utility>
#include <vector>

namespace constraint_sim::python {
namespace {

[[noreturn]] void refuse(const std::string& field, const std::string& expected, py::handle value) {
  throw std::invalid_argument(field + ": must be " + expected + ", got " +
                              std::string(py::str(py::repr(value))));
}

bool is_bool(py::handle value) {
  return PyBool_Check(value.ptr()) != 0 ||
         std::string(py::str(value.get_type().attr("__name__"))).rfind("bool", 0) == 0;
}

}  // namespace

double number(const std::string& field, py::handle value) {
  if (is_bool(value) || PyUnicode_Check(value.ptr()) != 0) refuse(field, "a number", value);
  const double converted = PyFloat_AsDouble(value.ptr());
  if (PyErr_Occurred() != nullptr) {
    PyErr_Clear();
    refuse(field, "a number", value);
  }
  return converted;
}

Keywords::Keywords(std::string function, py::dict arguments)
    : function_(std::move(function)), arguments_(std::move(arguments)) {}

py::object Keywords::find(const char* key) {
  known_.insert(key);
  if (!arguments_.contains(key)) return {};
  return arguments_[key];
}

void Keywords::read(const char* key, double* target) {
  if (const py::object value = find(key)) *target = number(key, value);
}

void Keywords::read(const char* key, std::optional<double>* target) {
  const py::object value = find(key);
  if (!value) return;
  target->reset();
  if (!value.is_none()) *target = number(key, value);
}

void Keywords::read(const char* key, int* target) {
  const py::object value = find(key);
  if (!value) return;
  if (is_bool(value) || PyIndex_Check(value.ptr()) == 0) refuse(key, "a whole number", value);
  int overflow = 0;
  const auto index = py::reinterpret_steal<py::object>(PyNumber_Index(value.ptr()));
  const long converted = PyLong_AsLongAndOverflow(index.ptr(), &overflow);
  if (overflow != 0 || converted != static_cast<int>(converted))
    refuse(key, "a whole number of 32 bits", value);
  *target = static_cast<int>(converted);
}

void Keywords::read(const char* key, bool* target) {
  const py::object value = find(key);
  if (!value) return;
  if (!is_bool(value)) refuse(key, "True or False", value);
  *target = PyObject_IsTrue(value.ptr()) == 1;
}

void Keywords::read(const char* key, std::string* target) {
  const py::object value = find(key);
  if (!value) return;
  if (PyUnicode_Check(value.ptr()) == 0) refuse(key, "a str", value);
  *target = std::string(py::str(value));
}

template <class Vector>
void Keywords::read_numbers(const char* key, Vector* target) {
  const py::object value = find(key);
  if (!value) return;
  const std::string expected = std::to_string(target->size()) + " numbers";
  if (PyUnicode_Check(value.ptr()) != 0) refuse(key, expected, value);
  const auto list = py::reinterpret_steal<py::object>(PySequence_Fast(value.ptr(), ""));
  if (!list) {
    PyErr_Clear();
    refuse(key, expected, value);
  }
  const auto size = static_cast<Eigen::Index>(PySequence_Fast_GET_SIZE(list.ptr()));
  if (size != target->size()) refuse(key, expected, value);
  for (Eigen::Index i = 0; i < size; ++i)
    (*target)[i] = number(key, PySequence_Fast_GET_ITEM(list.ptr(), i));
}

void Keywords::read(const char* key, Eigen::Vector3d* target) { read_numbers(key, target); }

void Keywords::read(const char* key, Eigen::Quaterniond* target) {
  read_numbers(key, &target->coeffs());
}

void Keywords::expect_no_more() const {
  for (const auto& argument : arguments_) {
    const std::string key = py::str(argument.first);
    if (known_.count(key) > 0) continue;
    std::string message = function_;
    message.append("() has no argument '").append(key).append("'; there are ");
    for (const std::string& name : known_)
      message.append(name == *known_.begin() ? "" : ", ").append(name);
    throw py::type_error(message);
  }
}

}  // namespace constraint_sim::python
