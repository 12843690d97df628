#pragma once

#include <exception>
#include <stdexcept>
#include <string>

namespace constraint_sim {

/// Returns the message of the present exception, of any type. Call only within a catch block.
inline std::string message_of_exception() {
  try {
    throw;
  } catch (const std::exception& error) {
    return error.what();
  } catch (...) {
    return "an exception of no known type";
  }
}

/// Throws std::invalid_argument that names a field of a message or file, and says what is wrong
/// with it.
[[noreturn]] inline void refuse(const std::string& field, const std::string& why) {
  throw std::invalid_argument(field + ": " + why);
}

}  // namespace constraint_sim
