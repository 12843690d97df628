#pragma once

#include "sim/errors.h"

namespace constraint_sim {

/// Runs `work` and fills in the fields common to all responses. An exception, mostly from bad
/// input, becomes `success: False` with its text, so that roscpp still delivers the response.
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
