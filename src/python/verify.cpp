#include "constraint_sim/engine/verify.h"

#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <chrono>
#include <cmath>
#include <string>

#include "constraint_sim/engine/scene.h"
#include "python/definitions.h"
#include "python/keywords.h"
#include "python/parameters.h"

namespace constraint_sim::python {
namespace {

py::object number_or_none(double value) {
  return std::isnan(value) ? py::object(py::none()) : py::object(py::float_(value));
}

py::dict figures_dict(const engine::VerifiedFigures& figures) {
  py::dict dict;
  dict["time"] = figures.time;
  dict["estimate"] = number_or_none(figures.estimate);
  dict["growth"] = figures.growth;
  dict["global_error"] = number_or_none(figures.global_error());
  dict["half_step"] = number_or_none(figures.half_step);
  dict["other_method"] = number_or_none(figures.other_method);
  dict["other_error"] = number_or_none(figures.other_error);
  return dict;
}

py::dict bodies_dict(const engine::VerifyReport& report) {
  py::dict bodies;
  for (const engine::VerifiedBody& body : report.bodies) {
    py::dict dict = figures_dict(body.figures);
    dict["verdict"] = body.verdict();
    dict["exceeded"] = body.exceeded ? py::object(figures_dict(*body.exceeded)) : py::none();
    dict["chaotic_from"] =
        body.chaotic_from ? py::object(py::float_(*body.chaotic_from)) : py::none();
    dict["unresolved"] = body.is_unresolved;
    dict["no_estimate"] = body.no_estimate;
    dict["no_half_step"] = body.no_half_step;
    dict["no_other_method"] = body.no_other_method;
    bodies[py::str(body.name)] = dict;
  }
  return bodies;
}

/// Verifies a world that no other thread uses, without the GIL.
engine::VerifyReport verify_released(const engine::World& world, double duration,
                                     engine::VerifyOptions options) {
  options.ticks = steps_in(duration, world.options().time_step);
  constexpr auto kSignalInterval = std::chrono::milliseconds(100);
  auto signals_checked = std::chrono::steady_clock::now();
  options.progress = [&](std::uint64_t) {
    const auto now = std::chrono::steady_clock::now();
    if (now - signals_checked < kSignalInterval) return;
    signals_checked = now;
    const py::gil_scoped_acquire acquire;
    if (PyErr_CheckSignals() != 0) throw py::error_already_set();
  };
  const py::gil_scoped_release release;
  return engine::verify(world, options);
}

void read_options(Keywords* reading, engine::VerifyOptions* options) {
  reading->read("perturbation", &options->perturbation);
  reading->read("least", &options->least);
  reading->read("margin", &options->margin);
}

}  // namespace

void define_verify(WorldClass* world) {
  world->def(
      "verify",
      [](const SharedWorld& self, const py::object& duration, const py::kwargs& keywords) {
        engine::VerifyOptions options;
        Keywords reading("verify", keywords);
        read_options(&reading, &options);
        reading.expect_no_more();
        return verify_released(engine::World(self.read()), number("duration", duration), options);
      },
      py::arg("duration"),
      "verify(duration [s], *, perturbation=1e-10 [m], least=1e-6 [m], margin=100)\n\nRuns copies "
      "of the world for this simulated time: as it is, with half the time step, by another "
      "method, and from a perturbed state; compares the differences of each body with its error "
      "estimate times the growth of the perturbation (docs/verify.md). The world stays as it is.");
}

void define_verify(py::module* module) {
  using Report = engine::VerifyReport;
  py::class_<Report>(*module, "VerifyReport", "Outcome of World.verify. str() is a table.")
      .def_readonly("ticks", &Report::ticks, "ticks done by all runs")
      .def_readonly("time_step", &Report::time_step, "time step of the verified run [s]")
      .def_readonly("perturbation", &Report::perturbation, "actual perturbation of the twin [m]")
      .def_property_readonly(
          "method", [](const Report& report) { return engine::name(report.method); },
          "method requested by the options")
      .def_property_readonly(
          "other_method", [](const Report& report) { return engine::name(report.other_method); },
          "method requested for the other run")
      .def_property_readonly("bodies", &bodies_dict,
                             "dict by name of the dynamic bodies: dicts of time [s], estimate [m], "
                             "growth, global_error [m], half_step [m], other_method [m], "
                             "other_error [m], verdict ('holds', 'chaotic', 'exceeds'), "
                             "exceeded, chaotic_from [s], and why something is None")
      .def_property_readonly(
          "exceeds", [](const Report& report) { return report.exceeds(); },
          "whether a difference of any body exceeds what its estimate and growth allow")
      .def_readonly("failure", &Report::failure, "reason why the runs ended early; empty otherwise")
      .def("__str__", [](const Report& report) { return engine::to_table(report); });
  module->def(
      "verify",
      [](const std::string& scene, const py::object& duration, const py::kwargs& keywords) {
        engine::VerifyOptions options;
        py::dict of_world;
        py::dict of_verify;
        for (const auto& [key, value] : keywords) {
          const std::string name = py::str(key);
          const bool is_own = name == "perturbation" || name == "least" || name == "margin";
          (is_own ? of_verify : of_world)[key] = value;
        }
        Keywords reading("verify", of_verify);
        read_options(&reading, &options);
        engine::WorldOptions defaults;
        options_from(of_world, &defaults);
        return verify_released(engine::load_scene(scene, "scene", defaults),
                               number("duration", duration), options);
      },
      py::arg("scene"), py::arg("duration"),
      "verify(scene, duration [s], *, perturbation=1e-10 [m], least=1e-6 [m], margin=100, "
      "**defaults)\n\nWorld.verify of a scene in YAML.");
}

}  // namespace constraint_sim::python
