#pragma once

#include <pybind11/pybind11.h>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>
#include <set>
#include <string>

namespace constraint_sim::python {

namespace py = pybind11;

/// Number in a Python object; bool and str are none. Throws std::invalid_argument naming `field`.
double number(const std::string& field, py::handle value);

/// A copy of keyword arguments that is read without running any code of Python's: sequences become
/// tuples, dicts new dicts, and numbers of other classes floats and ints. To be made before a world
/// is looked at, since an argument's `__float__` can change the argument, or let another thread
/// step the world. A value that is no argument of any function stays as it is; reading it throws.
py::dict frozen(const py::dict& arguments);

/// Keyword arguments of one Python function. `read` converts the argument named `key` into
/// `target`, which keeps its value when the argument is absent. A wrong type or length throws
/// std::invalid_argument("KEY: must be ..., got VALUE").
class Keywords {
 public:
  Keywords(std::string function, py::dict arguments);

  void read(const char* key, double* target);
  void read(const char* key, std::optional<double>* target);  ///< None is nothing
  void read(const char* key, int* target);
  void read(const char* key, bool* target);
  void read(const char* key, std::string* target);
  void read(const char* key, Eigen::Vector3d* target);
  void read(const char* key, Eigen::Quaterniond* target);  ///< x, y, z, w
  /// Argument of a type that `read` does not know; a null handle when it is absent.
  py::object find(const char* key);
  /// Throws TypeError when there is an argument that nobody has asked for.
  void expect_no_more() const;

 private:
  template <class Vector>
  void read_numbers(const char* key, Vector* target);

  std::string function_;
  py::dict arguments_;
  std::set<std::string> known_;
};

}  // namespace constraint_sim::python
