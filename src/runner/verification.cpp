#include "runner/verification.h"

#include <string>

namespace constraint_sim::engine {
namespace {

nlohmann::json json_of(const VerifiedFigures& figures) {
  return {
      {"time", figures.time},
      {"estimate", figures.estimate},
      {"growth", figures.growth},
      {"global_error", figures.global_error()},
      {"half_step", figures.half_step},
      {"other_method", figures.other_method},
      {"other_error", figures.other_error},
  };
}

nlohmann::json text_or_null(const std::string& text) {
  return text.empty() ? nlohmann::json() : nlohmann::json(text);
}

}  // namespace

nlohmann::json json_of(const VerifyReport& verified) {
  nlohmann::json bodies = nlohmann::json::object();
  for (const VerifiedBody& body : verified.bodies) {
    nlohmann::json& entry = bodies[body.name] = json_of(body.figures);
    entry["verdict"] = body.verdict();
    entry["exceeded"] = body.exceeded ? json_of(*body.exceeded) : nlohmann::json();
    entry["chaotic_from"] =
        body.chaotic_from ? nlohmann::json(*body.chaotic_from) : nlohmann::json();
    entry["unresolved"] = body.is_unresolved;
    entry["no_estimate"] = text_or_null(body.no_estimate);
    entry["no_half_step"] = text_or_null(body.no_half_step);
    entry["no_other_method"] = text_or_null(body.no_other_method);
  }
  return {
      {"ticks", verified.ticks},
      {"time_step", verified.time_step},
      {"perturbation", verified.perturbation},
      {"method", name(verified.method)},
      {"other_method", name(verified.other_method)},
      {"exceeds", verified.exceeds()},
      {"stopped", verified.stopped},
      {"failure", verified.failure},
      {"bodies", bodies},
  };
}

}  // namespace constraint_sim::engine
