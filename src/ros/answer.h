#pragma once

#include "sim/errors.h"

namespace constraint_sim {

/// Runs `work` and fills in what every answer has. Errors, bad input foremost, are answered and not
/// thrown, so that roscpp passes the response on.
template <class Response, class Work>
bool answer(Response& response, Work work) {
  try {
    work();
    response.success = true;
  } catch (...) {
    response = Response{};
    response.status_message = message_of_exception();
  }
  return true;
}

}  // namespace constraint_sim
