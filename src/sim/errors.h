#pragma once

#include <exception>
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

}  // namespace constraint_sim
