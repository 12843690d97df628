#pragma once

#include <pybind11/pybind11.h>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <set>
#include <string>

namespace constraint_sim::python {

namespace py = pybind11;

/// Returns the number in a Python object; bool and str are rejected. Throws std::invalid_argument
/// naming `field`.
double number(const std::string& field, py::handle value);

/// Copies keyword arguments so that reading them runs no Python code: sequences become tuples,
/// dicts new dicts, other numbers floats and ints. Copy before accessing a world, since an
/// argument's `__float__` may change the argument, or let another thread step the world. Values of
/// unsupported types stay; reading them throws.
py::dict frozen(const py::dict& arguments);

/// Keyword arguments of one Python function. `read` converts the argument named `key` into
/// `target`, which keeps its value when the argument is absent. A wrong type or length throws
/// std::invalid_argument("KEY: must be ..., got VALUE").
class Keywords {
 public:
  Keywords(std::string function, py::dict arguments);

  void read(const char* key, double* target);
  void read(const char* key, std::optional<double>* target);  ///< None resets the value
  void read(const char* key, int* target);
  void read(const char* key, std::uint32_t* target);
  void read(const char* key, bool* target);
  void read(const char* key, std::string* target);
  void read(const char* key, Eigen::Vector3d* target);
  void read(const char* key, Eigen::Quaterniond* target);  ///< x, y, z, w
  /// Returns an argument of a type that `read` does not support; a null handle when it is absent.
  py::object find(const char* key);
  /// Throws TypeError for an argument that was not read.
  void expect_no_more() const;

 private:
  /// Reads a whole number that Whole holds.
  template <class Whole>
  void read_whole(const char* key, Whole* target);
  template <class Vector>
  void read_numbers(const char* key, Vector* target);

  std::string function_;
  py::dict arguments_;
  std::set<std::string> known_;
};

}  // namespace constraint_sim::python
