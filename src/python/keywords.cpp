#include "python/keywords.h"

#include <optional>
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

// Length of the longest sequence that any function takes, plus one.
constexpr std::size_t kMostElements = 17;

/// Returns the first kMostElements elements of an iterable; none for other objects.
std::optional<std::vector<py::object>> elements_of(py::handle value) {
  const auto iterator = py::reinterpret_steal<py::object>(PyObject_GetIter(value.ptr()));
  std::vector<py::object> elements;
  while (iterator && elements.size() < kMostElements) {
    auto element = py::reinterpret_steal<py::object>(PyIter_Next(iterator.ptr()));
    if (!element) break;
    elements.push_back(std::move(element));
  }
  if (PyErr_Occurred() != nullptr) {
    PyErr_Clear();
    return std::nullopt;
  }
  return elements;
}

py::object frozen_value(py::handle value, int depth);

/// Returns a number of a class that is not built into Python; a null handle for other objects.
py::object frozen_number(py::handle value) {
  if (PyNumber_Check(value.ptr()) == 0) return {};
  PyObject* const number = PyIndex_Check(value.ptr()) != 0 ? PyNumber_Index(value.ptr()) : nullptr;
  if (number != nullptr) return py::reinterpret_steal<py::object>(number);
  PyErr_Clear();
  const double converted = PyFloat_AsDouble(value.ptr());
  if (PyErr_Occurred() == nullptr) return py::float_(converted);
  PyErr_Clear();
  return {};
}

py::dict frozen_dict(const py::dict& arguments, int depth) {
  // Copies the items to a list first: Python code may change a dict during iteration.
  const auto items = py::reinterpret_steal<py::list>(PyDict_Items(arguments.ptr()));
  py::dict copy;
  for (const py::handle item : items) {
    const auto pair = py::reinterpret_borrow<py::tuple>(item);
    copy[pair[0]] = frozen_value(pair[1], depth);
  }
  return copy;
}

py::object frozen_value(py::handle value, int depth) {
  constexpr int kMostDepth = 4;  // a dict in a list in a dict, and its numbers
  const auto as_it_is = py::reinterpret_borrow<py::object>(value);
  PyObject* const object = value.ptr();
  if (object == Py_None || PyFloat_CheckExact(object) || PyLong_CheckExact(object) ||
      PyUnicode_CheckExact(object) || PyBool_Check(object) || depth > kMostDepth)
    return as_it_is;
  if (PyUnicode_Check(object))
    return py::reinterpret_steal<py::object>(PyUnicode_FromObject(object));
  if (is_bool(value)) {
    const int truth = PyObject_IsTrue(object);
    if (truth >= 0) return py::bool_(truth == 1);
    PyErr_Clear();
    return as_it_is;
  }
  if (PyDict_Check(object)) return frozen_dict(py::reinterpret_borrow<py::dict>(value), depth + 1);
  if (const py::object number = frozen_number(value)) return number;
  const auto elements = elements_of(value);
  if (!elements || elements->size() == kMostElements) return as_it_is;
  py::tuple copy(elements->size());
  for (std::size_t i = 0; i < elements->size(); ++i)
    copy[i] = frozen_value((*elements)[i], depth + 1);
  return std::move(copy);
}

}  // namespace

py::dict frozen(const py::dict& arguments) { return frozen_dict(arguments, 0); }

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

void Keywords::read(const char* key, int* target) { read_whole(key, target); }
void Keywords::read(const char* key, std::uint32_t* target) { read_whole(key, target); }

template <class Whole>
void Keywords::read_whole(const char* key, Whole* target) {
  const py::object value = find(key);
  if (!value) return;
  if (is_bool(value) || PyIndex_Check(value.ptr()) == 0) refuse(key, "a whole number", value);
  int overflow = 0;
  const auto index = py::reinterpret_steal<py::object>(PyNumber_Index(value.ptr()));
  const long long converted = PyLong_AsLongLongAndOverflow(index.ptr(), &overflow);
  if (overflow != 0 || converted != static_cast<long long>(static_cast<Whole>(converted)))
    refuse(key, "a whole number of 32 bits", value);
  *target = static_cast<Whole>(converted);
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
  // The elements are referenced here, since converting one may change the sequence.
  const auto elements = elements_of(value);
  if (!elements || elements->size() != static_cast<std::size_t>(target->size()))
    refuse(key, expected, value);
  for (std::size_t i = 0; i < elements->size(); ++i)
    (*target)[static_cast<Eigen::Index>(i)] = number(key, (*elements)[i]);
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
