#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "constraint_sim/engine/world.h"

namespace constraint_sim::python {

namespace py = pybind11;

/// Numbers per body in the arrays: position, orientation x y z w, linear and angular velocity.
constexpr py::ssize_t kStateSize = 13;

/// Returns the ticks in a duration [s], rounded to nearest as in the runner. Throws for a negative
/// or too long duration.
std::uint64_t steps_in(double duration, double time_step);

/// Report of a step with the names of bodies and joints it refers to, if they still exist.
struct NamedReport : engine::StepReport {
  explicit NamedReport(const engine::World& world);
  std::optional<std::string> worst_joint_name, closing_joint_name, failed_body_name,
      overlap_body_name, creep_body_name, unsolved_body_name;
};

/// Result of World.run: worst values and sums over all steps.
struct RunReport {
  std::uint64_t steps = 0;
  bool failed = false;  ///< a step failed; the world kept the state before the step
  std::string failure;  ///< reason, in words
  std::optional<std::string> failed_body;
  bool timed_out = false;  ///< `time_limit` was reached before the end
  double wall_time = 0.0;  ///< time spent in steps [s]
  double max_constraint_error = 0.0, max_closing_error = 0.0, max_penetration = 0.0;  ///< [m]
  double accumulated_local_error = 0.0;                                               ///< [m]
  double energy_initial = 0.0, energy_final = 0.0;                                    ///< [J]
  double energy_drift = 0.0;                        ///< after the last step, dimensionless
  double correction_work = 0.0, driven_work = 0.0;  ///< sums [J]
  double solver_residual = 0.0;                     ///< largest of all steps [m/s]
  double energy_rise = 0.0;                         ///< largest of all steps [J]
  double overlap = 0.0, creep = 0.0;                ///< largest of all steps [m]
  std::set<std::string> methods, unresolved_bodies, unclosed_joints;  ///< by name
  std::uint64_t substeps = 0, rejected = 0, iterations = 0, rows = 0, contacts = 0;
  std::uint64_t torn_joints = 0, changes = 0;
  std::uint32_t dependent_rows = 0;                    ///< largest of all steps
  py::object times = py::none(), states = py::none();  ///< arrays, where samples were requested
};

/// A world with the data for Python: the buffer behind its state arrays, and a mark while a thread
/// steps it. Members are accessed under the GIL only.
class SharedWorld {
 public:
  explicit SharedWorld(engine::World world) : world_(std::move(world)) {}

  /// Returns the world for reading. Throws std::runtime_error while another thread steps it.
  const engine::World& read() const;
  /// Returns `action(world)`, and updates Python's arrays afterwards.
  template <class Action>
  auto edit(Action action);

  /// Returns columns [first, first + count) of all bodies, as a read-only view into the buffer.
  py::array columns(py::ssize_t first, py::ssize_t count);
  NamedReport step();
  /// Runs for a duration [s]. Samples are taken at the start and every `every` ticks; 0: none.
  RunReport run(double duration, std::uint64_t every, double time_limit);

 private:
  /// Rows of kStateSize numbers; lives as long as the world or an array needs it.
  using Buffer = std::vector<double>;

  /// Releases the GIL and marks the world as stepping, while the object lives.
  class Stepping;
  struct Samples {
    std::vector<double> times, states;
  };

  void check_idle() const;
  void update_arrays();
  static void write_states(const engine::World& world, const std::vector<engine::BodyId>& ids,
                           double* target);
  void run_released(std::uint64_t steps, std::uint64_t every, double time_limit, RunReport* report,
                    Samples* samples);

  engine::World world_;
  bool is_stepping_ = false;
  std::shared_ptr<Buffer> buffer_;   ///< null until an array is requested
  std::vector<engine::BodyId> ids_;  ///< ids of the buffer's rows
};

/// Updates the arrays also when `action` throws: an edit of the engine changes all or nothing.
template <class Action>
auto SharedWorld::edit(Action action) {
  check_idle();
  struct Update {
    SharedWorld* world;
    ~Update() { world->update_arrays(); }
  } update{this};
  return action(world_);
}

}  // namespace constraint_sim::python
