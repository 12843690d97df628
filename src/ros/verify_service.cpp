#include "ros/verify_service.h"

#include <cmath>
#include <stdexcept>
#include <string>

#include "constraint_sim/engine/verify.h"
#include "ros/answer.h"
#include "ros/guarded.h"

namespace constraint_sim {
namespace {

// Returns the missing figures of a body, with reasons.
std::string left_out(const engine::VerifiedBody& body) {
  std::string text;
  const auto add = [&](const char* what, const std::string& why) {
    if (!why.empty()) text += (text.empty() ? "" : "; ") + std::string(what) + ": " + why;
  };
  add("estimate", body.no_estimate);
  add("half step", body.no_half_step);
  add("other method", body.no_other_method);
  return text;
}

void fill_in(const engine::VerifyReport& report, VerifyResponse* response) {
  response->steps = static_cast<std::uint32_t>(report.ticks);
  response->time_step = report.time_step;
  response->perturbation = report.perturbation;
  response->method = engine::name(report.method);
  response->other_method = engine::name(report.other_method);
  response->exceeds = report.exceeds();
  for (const engine::VerifiedBody& body : report.bodies) {
    const engine::VerifiedFigures& shown = body.exceeded ? *body.exceeded : body.figures;
    response->bodies.push_back(body.name);
    response->verdicts.push_back(body.verdict());
    response->times.push_back(shown.time);
    response->estimates.push_back(shown.estimate);
    response->growths.push_back(shown.growth);
    response->global_errors.push_back(shown.global_error());
    response->half_step_differences.push_back(shown.half_step);
    response->other_method_differences.push_back(shown.other_method);
    response->left_out.push_back(left_out(body));
  }
  response->table = engine::to_table(report);
}

}  // namespace

VerifyService::VerifyService(Stepper& stepper, ros::NodeHandle handle) : stepper_(stepper) {
  server_ = guarded_service(handle, "verify", &VerifyService::verify, this);
}

void VerifyService::stop() {
  stopping_ = true;
  cancel_ = true;
}

bool VerifyService::verify(VerifyRequest& request, VerifyResponse& response) {
  return answer(response, [&] {
    if (request.steps == 0) {
      if (!is_running_) throw std::invalid_argument("steps: no verification runs to be cancelled");
      cancel_ = true;
      return;
    }
    if (request.steps > kMostSteps)
      throw std::invalid_argument("steps: must be at most " + std::to_string(kMostSteps) +
                                  ", got " + std::to_string(request.steps));
    if (is_running_.exchange(true))
      throw NotNow("not now: a verification runs; `steps: 0` cancels it");
    struct End {
      VerifyService* service;
      ~End() {
        service->cancel_ = service->stopping_.load();
        service->is_running_ = false;
      }
    } end{this};
    if (stopping_) throw Cancelled();
    run(request.steps, &response);
  });
}

// Verifies on a copy of the world, so that the stepping thread does not wait.
void VerifyService::run(std::uint32_t steps, VerifyResponse* response) {
  World world;
  stepper_.inspect([&](const World& now) { world = now; });
  engine::VerifyOptions options;
  options.ticks = steps;
  options.stop = &cancel_;
  const engine::VerifyReport report = engine::verify(world, options);
  if (report.stopped)
    throw NotNow("cancelled: " + std::to_string(report.ticks) + " of " + std::to_string(steps) +
                 " ticks done");
  if (report.ticks == 0) throw std::runtime_error("the run " + report.failure);
  fill_in(report, response);
}

}  // namespace constraint_sim
