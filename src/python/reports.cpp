#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "python/definitions.h"

namespace constraint_sim::python {
namespace {

py::dict islands_of(const NamedReport& report) {
  py::dict dict;
  for (std::size_t i = 0; i < engine::kMethodCount; ++i)
    if (static_cast<engine::Method>(i) != engine::Method::kAuto)
      dict[engine::name(static_cast<engine::Method>(i))] = report.costs.islands[i];
  return dict;
}

/// Returns a getter of a field in a part of the report.
template <class Part, class Field>
auto field_of(Part engine::StepReport::*part, Field Part::*field) {
  return [part, field](const NamedReport& report) { return report.*part.*field; };
}

void define_step_report(py::module* module) {
  using Report = NamedReport;
  py::class_<Report>(
      *module, "StepReport",
      "Counts, errors and costs of one step. A copy: it keeps its values when the world "
      "steps on.")
      .def_readonly("step", &Report::step, "steps since the start, this one included")
      .def_readonly("time", &Report::time, "simulated time after the step [s]")
      .def_property_readonly(
          "max_constraint_error", field_of(&Report::joints, &Report::Joints::max_error),
          "largest |error| of the joints, springs and closing_error excepted [m]")
      .def_readonly("worst_joint", &Report::worst_joint_name, "joint whose error it is, or None")
      .def_property_readonly(
          "closing_error", field_of(&Report::joints, &Report::Joints::closing_error),
          "largest |error| of joints that an edit, or a motor sent to a position, is "
          "closing [m]")
      .def_readonly("closing_joint", &Report::closing_joint_name,
                    "joint whose error it is, or None")
      .def_property_readonly("unclosed_joints",
                             field_of(&Report::joints, &Report::Joints::unclosed),
                             "joints off by more than 1e-3 m that are not being closed")
      .def_property_readonly("max_penetration",
                             field_of(&Report::contacts, &Report::Contacts::max_penetration),
                             "deepest contact [m]")
      .def_property_readonly("overlap", field_of(&Report::contacts, &Report::Contacts::overlap),
                             "deepest contact that impulses do not push out [m]; 0: none")
      .def_readonly("overlap_body", &Report::overlap_body_name, "a body of that contact, or None")
      .def_property_readonly(
          "creep", field_of(&Report::contacts, &Report::Contacts::creep),
          "farthest that a contact by impulses has slid while friction holds it [m]; 0: "
          "none")
      .def_readonly("creep_body", &Report::creep_body_name, "a body of that contact, or None")
      .def_readonly("unsolved_body", &Report::unsolved_body_name,
                    "with time_stepping, a body whose impulses were not solved, or None; "
                    "solver_residual says how far")
      .def_property_readonly("energy", field_of(&Report::energy, &Report::Energy::total),
                             "kinetic energy + potential energy of gravity and springs [J]")
      .def_property_readonly(
          "energy_drift", field_of(&Report::energy, &Report::Energy::drift),
          "change of energy since the last edit over the largest kinetic energy [1]")
      .def_property_readonly("energy_rise", field_of(&Report::energy, &Report::Energy::rise),
                             "rise of an island's energy without a cause [J]; 0: none")
      .def_property_readonly(
          "local_error", [](const Report& report) { return known(report.local_error); },
          "largest error estimate of an island for this step [m]; None where an island has none, "
          "as where impulses were not solved")
      .def_property_readonly("dependent_rows",
                             field_of(&Report::joints, &Report::Joints::dependent_rows),
                             "redundant equations, at most at once")
      .def_readonly("unresolved_bodies", &Report::unresolved_bodies,
                    "bodies of stiff islands that move faster than the step resolves")
      .def_property_readonly("torn_joints", field_of(&Report::joints, &Report::Joints::broken),
                             "joints that broke in this step")
      .def_property_readonly(
          "projected_energy", field_of(&Report::energy, &Report::Energy::projected),
          "kinetic energy lost where velocities were projected onto the joints [J]")
      .def_property_readonly(
          "correction_work", field_of(&Report::energy, &Report::Energy::correction_work),
          "work of closing errors where impulses advance islands: weight times the "
          "distance moved [J]")
      .def_property_readonly(
          "driven_work", field_of(&Report::energy, &Report::Energy::driven_work),
          "work of wrenches, motors and kinematic bodies where impulses advance islands [J]")
      .def_property_readonly("solver_residual",
                             field_of(&Report::contacts, &Report::Contacts::solver_residual),
                             "largest |J V - target| that the sweeps left [m/s]")
      .def_property_readonly("failed", field_of(&Report::outcome, &Report::Outcome::failed),
                             "the world kept the state before the step")
      .def_property_readonly(
          "failure", [](const Report& report) { return engine::to_string(report.outcome.failure); },
          "reason why the step failed; empty where it did not")
      .def_readonly("failed_body", &Report::failed_body_name,
                    "body whose motion failed, or None where the failure is not of a single body")
      .def_property_readonly(
          "stopped", field_of(&Report::outcome, &Report::Outcome::stopped),
          "a stop flag ended the step early: the world kept the state before it; C++ "
          "alone can set one")
      .def_property_readonly("islands", &islands_of, "islands advanced by each method")
      .def_property_readonly("asleep", field_of(&Report::costs, &Report::Costs::asleep),
                             "islands at rest, left out")
      .def_property_readonly("changes", field_of(&Report::costs, &Report::Costs::method_changes),
                             "changes of method")
      .def_property_readonly("handed_over",
                             field_of(&Report::contacts, &Report::Contacts::handed_over),
                             "islands whose contacts go from events to impulses")
      .def_property_readonly("substeps", field_of(&Report::costs, &Report::Costs::substeps),
                             "substeps of all islands")
      .def_property_readonly("rejected", field_of(&Report::costs, &Report::Costs::rejected),
                             "rejected substeps")
      .def_property_readonly("evaluations", field_of(&Report::costs, &Report::Costs::evaluations),
                             "evaluations of the equations of motion in explicit substeps")
      .def_property_readonly("iterations", field_of(&Report::costs, &Report::Costs::iterations),
                             "sweeps over the rows, and Newton iterations")
      .def_property_readonly("events", field_of(&Report::costs, &Report::Costs::events),
                             "events at which a one-sided row began or ceased to act")
      .def_property_readonly("hits", field_of(&Report::contacts, &Report::Contacts::hits),
                             "hits of fast bodies, at their times within the step")
      .def_property_readonly("rows", field_of(&Report::costs, &Report::Costs::rows),
                             "scalar equations solved")
      .def_property_readonly("contacts", field_of(&Report::contacts, &Report::Contacts::points),
                             "contact points of islands that are awake")
      .def_property_readonly("candidate_pairs",
                             field_of(&Report::costs, &Report::Costs::candidate_pairs),
                             "pairs after the broadphase")
      .def("__repr__", [](const Report& report) {
        return py::str("<StepReport step {} time {} s: constraint error {:.3g} m, failed {}>")
            .format(report.step, report.time, report.joints.max_error, report.outcome.failed);
      });
}

void define_run_report(py::module* module) {
  py::class_<RunReport>(*module, "RunReport",
                        "Outcome of World.run: worst values over its steps, sums, and samples.")
      .def_readonly("steps", &RunReport::steps, "steps taken")
      .def_readonly("failed", &RunReport::failed,
                    "a step failed: the run ended with the state before it")
      .def_readonly("failure", &RunReport::failure, "reason; empty where no step failed")
      .def_readonly("failed_body", &RunReport::failed_body,
                    "body whose motion failed, or None where the failure is not of a single body")
      .def_readonly("timed_out", &RunReport::timed_out, "time_limit was reached before the end")
      .def_readonly("wall_time", &RunReport::wall_time, "run time of the steps alone [s]")
      .def_readonly("max_constraint_error", &RunReport::max_constraint_error,
                    "largest over all steps [m]")
      .def_readonly("max_closing_error", &RunReport::max_closing_error,
                    "largest StepReport.closing_error [m]")
      .def_readonly("max_penetration", &RunReport::max_penetration, "largest over all steps [m]")
      .def_property_readonly(
          "accumulated_local_error",
          [](const RunReport& report) { return known(report.accumulated_local_error); },
          "sum of the steps' estimates [m]; None where a step had none")
      .def_readonly("energy_initial", &RunReport::energy_initial, "before the first step [J]")
      .def_readonly("energy_final", &RunReport::energy_final, "after the last step [J]")
      .def_readonly("energy_drift", &RunReport::energy_drift,
                    "StepReport.energy_drift of the last step [1]")
      .def_readonly("correction_work", &RunReport::correction_work,
                    "work of closing errors where impulses advance islands, sum over all steps [J]")
      .def_readonly(
          "driven_work", &RunReport::driven_work,
          "work of wrenches, motors and kinematic bodies where impulses advance islands, sum "
          "over all steps [J]")
      .def_readonly("solver_residual", &RunReport::solver_residual,
                    "largest |J V - target| that the sweeps left, over all steps [m/s]")
      .def_readonly("methods", &RunReport::methods, "methods that advanced an island")
      .def_readonly("unresolved_bodies", &RunReport::unresolved_bodies,
                    "names of bodies that moved faster than a step resolves")
      .def_readonly("unclosed_joints", &RunReport::unclosed_joints,
                    "names of joints that were off by more than 1e-3 m, or 0.5 rad, and not being "
                    "closed at some step")
      .def_readonly("energy_rise", &RunReport::energy_rise,
                    "largest rise of an island's energy without a cause [J]; 0: none")
      .def_readonly("overlap", &RunReport::overlap, "largest StepReport.overlap [m]; 0: none")
      .def_readonly("creep", &RunReport::creep, "largest StepReport.creep [m]; 0: none")
      .def_readonly("substeps", &RunReport::substeps, "sum over all steps")
      .def_readonly("rejected", &RunReport::rejected, "rejected substeps, sum over all steps")
      .def_readonly("iterations", &RunReport::iterations, "sum over all steps")
      .def_readonly("rows", &RunReport::rows, "sum over all steps")
      .def_readonly("contacts", &RunReport::contacts, "sum over all steps")
      .def_readonly("torn_joints", &RunReport::torn_joints, "joints that broke")
      .def_readonly("changes", &RunReport::changes, "changes of method")
      .def_readonly("dependent_rows", &RunReport::dependent_rows,
                    "redundant equations, at most at once")
      .def_readonly("times", &RunReport::times,
                    "times of the samples [s], shape (samples,); or None")
      .def_readonly("states", &RunReport::states,
                    "samples of all bodies, shape (samples, bodies, 13) as World.states; or None")
      .def("__repr__", [](const RunReport& report) {
        return py::str("<RunReport {} steps: constraint error {:.3g} m, failed {}>")
            .format(report.steps, report.max_constraint_error, report.failed);
      });
}

}  // namespace

void define_reports(py::module* module) {
  define_step_report(module);
  define_run_report(module);
  for (const char* name : {"StepReport", "RunReport"})
    make_by_call_alone(py::object(module->attr(name)));
}

}  // namespace constraint_sim::python
