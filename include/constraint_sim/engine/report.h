#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "constraint_sim/engine/id.h"

namespace constraint_sim::engine {

/// Method by which a step advances an island.
enum class Method {
  kAuto,                ///< the world chooses
  kRungeKutta,          ///< embedded pairs of order 8 and 5, on smooth islands
  kEnergyMomentum,      ///< discrete gradients, order 2 and 4, on stiff islands
  kSequentialImpulses,  ///< the tutorial's six stages, on all other islands
  kEventDriven,         ///< kRungeKutta between events, on islands with one-sided rows
  /// The stages of kSequentialImpulses with impulses solved to a tolerance, on islands in contact.
  kTimeStepping,
};
inline constexpr std::size_t kMethodCount = 6;

/// Whether a method advances an island over the whole step by impulses of its rows.
constexpr bool uses_impulses(Method method) {
  return method == Method::kSequentialImpulses || method == Method::kTimeStepping;
}

/// Name as in scene files and reports: `auto`, `runge_kutta`, `energy_momentum`,
/// `sequential_impulses`, `event_driven`, `time_stepping`.
const char* name(Method method);

/// The stages of a step, in order.
enum class Stage {
  kBroadphase,
  kNarrowphase,
  /// Complete step of integrated islands; the later stages belong to sequential impulses.
  kIntegration,
  kRows,
  kVelocities,
  kSolve,
  kPositions,
};
inline constexpr std::size_t kStageCount = 7;

const char* name(Stage stage);

/// Reason for a failed step, which keeps the state before it.
enum class Failure {
  kNone,
  /// A number was not finite, the length of an orientation overflowed, or a saved number was beyond
  /// kMostMagnitude.
  kNotFinite,
  kOutOfRange,       ///< a body is farther or faster than kMostMagnitude
  kTooManyPairs,     ///< more than kMostPairs of bodies have overlapping bounding boxes
  kTooManyContacts,  ///< more than kMostContacts contact points
  /// The time is so large that adding a tick does not change it, or leads beyond kMostMagnitude.
  kNoNextTick,
  /// A function of another package threw, or returned a number that is not finite; see
  /// World::failed_joint() and World::failed_why().
  kCustom,
};

/// Describes the failure in one line of plain words; empty for kNone.
const char* to_string(Failure failure);

/// Largest coordinate of a position [m], velocity [m/s] and angular velocity [rad/s]. Squares and
/// cubes of such numbers, also times a mass, are finite.
inline constexpr double kMostMagnitude = 1e20;
/// Limits of a step, so that its time and memory are bounded; beyond them it fails.
inline constexpr std::size_t kMostPairs = 1000000;
inline constexpr std::size_t kMostContacts = 300000;
/// Number of hits of fast bodies that a step resolves.
inline constexpr std::uint32_t kMostHits = 20;

/// Error of a joint above which it is reported as unclosed [m], unless the error falls by a tenth
/// within 0.5 s, `closing_time` or 20 ticks, whichever is the longest. Less in proportion to the
/// radius of the shapes of its bodies where these are smaller than 10 mm.
inline constexpr double kUnclosedError = 1e-3;
/// Orientation error above which a joint is reported as unclosed [rad], so that joints of small
/// bodies are reported too. Rows of orientations have spurious solutions from 90 degrees on.
inline constexpr double kUnclosedAngle = 0.5;

/// Thresholds for reporting overlap and creep of contacts by impulses, as shares of the thinner
/// shape. kMostSlipShare replaces kMostCreepShare for bodies that have moved since the last edit.
/// Overlaps are reported after 0.1 s or ten ticks, whichever is longer; beyond kDeepOverlapShare,
/// from where contacts may push shapes apart on the wrong side, in the first tick.
inline constexpr double kDeepOverlapShare = 0.5, kMostOverlapShare = 0.01, kMostCreepShare = 1e-4,
                        kMostSlipShare = 0.05;

/// Figures of a step: counts, errors and costs.
struct StepReport {
  /// Errors of joints.
  struct Joints {
    /// Largest |error| [m], without springs and without joints that are being closed.
    double max_error = 0.0;
    std::optional<JointId> worst;  ///< joint with `max_error`
    /// Largest |error| of joints that are being closed after an edit, or after a motor was sent to
    /// a position [m].
    double closing_error = 0.0;
    std::optional<JointId> worst_closing;  ///< joint with `closing_error`
    /// Joints off by more than kUnclosedError or kUnclosedAngle that are not being closed.
    std::uint32_t unclosed = 0;
    std::optional<JointId> worst_unclosed;  ///< unclosed joint with the largest error
    std::uint32_t broken = 0;               ///< joints that broke in this step
    std::uint32_t dependent_rows = 0;       ///< largest number of redundant equations at any time
  };

  /// Energy and its balance.
  struct Energy {
    /// Kinetic energy, plus potential energy of gravity (0 at z = 0) and of springs [J]; without
    /// velocities that only correct errors in this step.
    double total = 0.0;
    /// Change of energy since the last edit over the largest kinetic energy since then [1];
    /// includes the work of motors, wrenches, friction and impacts.
    double drift = 0.0;
    /// Unexplained rise of energy above its minimum [J]; 0 within rounding and tolerance.
    double rise = 0.0;
    std::optional<BodyId> rise_body;  ///< first body of the island with the largest rise
    /// Kinetic energy lost when velocities were projected onto the joints, after a change of method
    /// or an edit [J].
    double projected = 0.0;
    /// Work of position corrections [J]: weight times distance where impulses advance islands, and
    /// the energy added where joints are inconsistent.
    double correction_work = 0.0;
    /// Work of wrenches, motors and kinematic bodies where impulses advance islands, and of
    /// kinematic bodies where contacts are event-driven [J].
    double driven_work = 0.0;
  };

  /// Contacts, their errors, and errors of the impulses.
  struct Contacts {
    std::uint32_t points = 0;      ///< contact points of awake islands
    double max_penetration = 0.0;  ///< deepest contact that the step met [m]
    /// Hits at their times within the step, of fast bodies, and where errors of contacts are
    /// controlled.
    std::uint32_t hits = 0;
    /// First fast body some of whose hits were left out; they come late or are missed. Reasons:
    /// kMostHits hits or 1000 parts in the step, a hit on a body that had taken its step, or a path
    /// that was longer than assumed in every repeat of the step.
    std::optional<BodyId> hits_left_body;
    /// Deepest contact by impulses [m] that stays deeper than 4 g h² and kMostOverlapShare of the
    /// thinner shape, or is deeper than kDeepOverlapShare.
    double overlap = 0.0;
    /// Body of the contact with `overlap`, movable where one is.
    std::optional<BodyId> overlap_body;
    /// Farthest slide of a contact by impulses while friction holds it [m], where above
    /// kMostCreepShare of the thinner shape.
    double creep = 0.0;
    /// Body of the contact with `creep`, movable where one is.
    std::optional<BodyId> creep_body;
    /// Largest |J V − target| after the sweeps, of velocities or of corrections [m/s].
    double solver_residual = 0.0;
    /// With time_stepping, a body whose impulses, and those of all bodies that it is in contact or
    /// jointed with, were not solved: `solver_residual` exceeds 1e-5 g h, which counts as rest.
    /// More than 500 bodies in contact are swept and not named; `solver_residual` alone tells their
    /// error.
    std::optional<BodyId> unsolved_body;
    /// Islands whose contacts change from event-driven to impulses.
    std::uint32_t handed_over = 0;
    std::optional<BodyId> handed_over_body;  ///< first body of the first such island
  };

  /// Whether the step was done.
  struct Outcome {
    bool failed = false;               ///< the step failed and kept the state before it
    Failure failure = Failure::kNone;  ///< reason for the failure
    /// Body with the invalid motion, where a single body is the cause.
    std::optional<BodyId> failed_body;
    bool stopped = false;  ///< the stop flag was set, and the step kept the state before it
  };

  /// Work of the step.
  struct Costs {
    std::array<std::uint32_t, kMethodCount> islands{};  ///< islands advanced by each method
    std::uint32_t asleep = 0;                           ///< islands at rest, which are skipped
    /// Changes of an island's method, within the step or since the previous one.
    std::uint32_t method_changes = 0;
    std::uint32_t substeps = 0;  ///< substeps of all islands
    std::uint32_t rejected = 0;  ///< rejected substeps
    /// Evaluations of the equations of motion in explicit substeps, rejected ones included.
    std::uint32_t evaluations = 0;
    /// Sweeps over the rows, and Newton iterations of stiff islands.
    std::uint32_t iterations = 0;
    std::uint32_t events = 0;           ///< moments at which a one-sided row began or ceased to act
    std::uint32_t rows = 0;             ///< scalar equations solved
    std::uint32_t candidate_pairs = 0;  ///< pairs of bodies that passed the broadphase
    /// Duration of each stage [s]; zero without a clock.
    std::array<double, kStageCount> stage_times{};
  };

  std::uint64_t step = 0;  ///< steps since the start, this one included
  double time = 0.0;       ///< simulated time after the step [s]
  /// Largest error estimate of an island for this step [m]; NaN where impulses were not solved or
  /// rows of more than 500 bodies were swept, where hits were left out, and where joints contradict
  /// each other.
  double local_error = 0.0;
  /// Bodies that move too fast for the time step: on stiff islands, and on joints by impulses.
  std::uint32_t unresolved_bodies = 0;
  Joints joints;
  Energy energy;
  Contacts contacts;
  Outcome outcome;
  Costs costs;
};

}  // namespace constraint_sim::engine
