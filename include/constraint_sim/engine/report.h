#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "constraint_sim/engine/id.h"

namespace constraint_sim::engine {

/// How an island is advanced by a step. Methods not listed do not exist yet.
enum class Method {
  kAuto,                ///< the world chooses
  kRungeKutta,          ///< embedded pairs of order 8 and 5, on smooth islands
  kEnergyMomentum,      ///< discrete gradients, order 2 and 4, on stiff islands
  kSequentialImpulses,  ///< the tutorial's six stages
  kEventDriven,         ///< as kRungeKutta between events, on islands with one-sided rows
};
inline constexpr std::size_t kMethodCount = 5;

/// As in scene files and reports: `auto`, `runge_kutta`, `energy_momentum`, `sequential_impulses`,
/// `event_driven`.
const char* name(Method method);

/// The stages of a step, in order.
enum class Stage {
  kBroadphase,
  kNarrowphase,
  kIntegration,  ///< of smooth islands, all the way; the stages below are for the others
  kRows,
  kVelocities,
  kSolve,
  kPositions,
};
inline constexpr std::size_t kStageCount = 7;

const char* name(Stage stage);

/// MethodReason a step has failed. The state before it is kept then.
enum class Failure {
  kNone,
  kNotFinite,        ///< a number was not finite
  kOutOfRange,       ///< a body is farther or faster than kMostMagnitude
  kTooManyPairs,     ///< more than kMostPairs of bodies overlap with their boxes
  kTooManyContacts,  ///< more than kMostContacts points touch
  kNoNextTick,       ///< the time is so long that a tick is lost beside it
  kCustom,           ///< functions of another package threw, or returned no finite number:
                     ///< World::failed_joint() and World::failed_why()
};

/// One line in plain words; empty for kNone.
const char* to_string(Failure failure);

/// Largest coordinate of a position [m], velocity [m/s] and angular velocity [rad/s], so that their
/// squares and cubes, and those times a mass, are finite.
inline constexpr double kMostMagnitude = 1e20;
/// What a step may have to do with: beyond these it fails, within a bounded time and memory.
inline constexpr std::size_t kMostPairs = 1000000;
inline constexpr std::size_t kMostContacts = 300000;
/// Hits of fast bodies that are looked for in a step.
inline constexpr std::uint32_t kMostHits = 20;

/// Error of a joint that is reported as unclosed: above this, and not falling by a tenth within 0.5
/// s, `closing_time` or 20 ticks, whichever is the longest [m].
inline constexpr double kUnclosedError = 1e-3;
/// The same of orientations, so that small bodies are reported as well: rows have solutions that
/// are not meant from 90 degrees on [rad].
inline constexpr double kUnclosedAngle = 0.5;

/// Overlap and creep of contacts that impulses hold are reported beyond these shares of the thinner
/// shape; creep of bodies that have moved since the last edit beyond the third one. Overlaps have
/// 0.1 s or ten ticks to be pushed out, whichever is longer.
inline constexpr double kMostOverlapShare = 0.01, kMostCreepShare = 1e-4, kMostSlipShare = 0.05;

/// What a step did, how wrong it is, and what it cost.
struct StepReport {
  std::uint64_t step = 0;  ///< steps since the start, this one included
  double time = 0.0;       ///< simulated time after the step [s]

  // how wrong
  double max_constraint_error = 0.0;   ///< largest |error| of the joints, springs and joints that
                                       ///< are being closed left out [m]
  std::optional<JointId> worst_joint;  ///< joint with that error
  double closing_error = 0.0;  ///< largest |error| of joints that an edit, or a motor sent to a
                               ///< position, is closing [m]
  std::optional<JointId> closing_joint;  ///< joint with that error
  std::uint32_t unclosed_joints = 0;     ///< off by more than kUnclosedError or kUnclosedAngle, and
                                         ///< not being closed
  std::optional<JointId> unclosed_joint;  ///< whose error is the largest of these
  double max_penetration = 0.0;           ///< deepest contact that the step met [m]
  double energy = 0.0;  ///< kinetic + potential of gravity and springs [J]; 0 height is z = 0;
                        ///< without velocities that close errors in this step alone
  double energy_drift = 0.0;  ///< change of energy since the last edit over the largest kinetic
                              ///< energy since then [1]; motors, wrenches, friction and impacts
                              ///< count as well
  double energy_rise = 0.0;   ///< without a cause, since it was least [J]; 0 where rounding and the
                              ///< tolerance explain it
  std::optional<BodyId> energy_rise_body;  ///< the first one of the island whose it is most
  double local_error = 0.0;          ///< largest estimate of an island for this step [m]; NaN where
                                     ///< impulses advanced an island, which have no estimate
  std::uint32_t dependent_rows = 0;  ///< equations that followed from others, at most at once
  std::uint32_t unresolved_bodies =
      0;                          ///< that move faster than a step can show: of stiff islands,
                                  ///< and by impulses those on joints that turn so fast
  std::uint32_t torn_joints = 0;  ///< that broke in this step
  std::optional<BodyId> hits_left_body;  ///< the first of fast bodies with more than kMostHits, or
                                         ///< a thousand parts of a step, or that hit what had its
                                         ///< step: later hits come late, or are missed
  double overlap = 0.0;  ///< deepest contact by impulses [m] that stays deeper than 4 g h² and
                         ///< kMostOverlapShare of the thinner shape
  std::optional<BodyId> overlap_body;  ///< body of that contact, movable where one is
  double creep = 0.0;  ///< farthest that a contact by impulses has slid while its friction holds
                       ///< it, where that is more than kMostCreepShare of the thinner shape [m]
  std::optional<BodyId> creep_body;  ///< body of that contact, movable where one is
  double projected_energy = 0.0;     ///< kinetic energy lost where velocities were made to fit the
                                     ///< joints, when a method took over or an edit came [J]
  double correction_work = 0.0;  ///< of closing errors where impulses advance islands: weight times
                                 ///< the distance moved for that; and where joints cannot all be
                                 ///< met, energy that corrections of positions added [J]
  double driven_work = 0.0;      ///< of wrenches, motors and kinematic bodies on islands that
                                 ///< impulses advance, and of kinematic bodies on those whose
                                 ///< contacts are by events [J]
  double solver_residual = 0.0;  ///< largest |J V − target| that the sweeps left, of the motion
                                 ///< or of what closes errors [m/s]
  bool failed = false;           ///< the state before the step was kept
  Failure failure = Failure::kNone;   ///< why
  std::optional<BodyId> failed_body;  ///< whose motion it was, where it was one body's
  bool stopped = false;               ///< the stop flag was set: the state before the step was kept

  // what it cost
  std::array<std::uint32_t, kMethodCount> islands{};  ///< advanced by each method
  std::uint32_t asleep = 0;                           ///< islands at rest, that were left out
  std::uint32_t changes = 0;      ///< of islands' methods, since the step before or within it
  std::uint32_t handed_over = 0;  ///< islands whose contacts go from events to impulses
  std::optional<BodyId> handed_over_body;  ///< the first one of the first of these
  std::uint32_t substeps = 0;              ///< of all islands
  std::uint32_t rejected = 0;              ///< substeps tried without result
  std::uint32_t iterations = 0;            ///< sweeps over the rows, and Newton's of stiff islands
  std::uint32_t events = 0;                ///< at which a one-sided row began or ceased to act
  std::uint32_t hits = 0;                  ///< of fast bodies, at their times within the step
  std::uint32_t rows = 0;                  ///< scalar equations solved
  std::uint32_t contacts = 0;              ///< contact points, but for those of islands at rest
  std::uint64_t broadphase_tests = 0;      ///< box against box
  std::uint32_t candidate_pairs = 0;       ///< that the broadphase let through
  std::array<double, kStageCount> stage_times{};  ///< [s]; zero unless a clock was given
};

}  // namespace constraint_sim::engine
