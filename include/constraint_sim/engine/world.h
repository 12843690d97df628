#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/contact.h"
#include "constraint_sim/engine/event.h"
#include "constraint_sim/engine/id.h"
#include "constraint_sim/engine/island.h"
#include "constraint_sim/engine/joint.h"
#include "constraint_sim/engine/options.h"
#include "constraint_sim/engine/report.h"
#include "constraint_sim/engine/stop_flag.h"
#include "constraint_sim/engine/warning.h"
#include "constraint_sim/engine/wrench.h"

namespace constraint_sim::engine {

/// A clock: returns the time since an arbitrary origin [s].
using Clock = double (*)();

/// Bodies, joints and their motion, in SI units; the world frame is right-handed.
///
/// World is a value: a copy continues with the same bits. Every function checks its arguments
/// first: bad input throws std::invalid_argument("FIELD: why, with the value") and changes nothing.
/// An id of another world, or of a removed body or joint, is bad input. step() does not throw for
/// physics: it reports. References stay valid until the next call that is not const.
class World {
 public:
  /// Makes a world without bodies, at time 0. Throws for options out of range.
  explicit World(const WorldOptions& options = {});
  World(const World& other);
  World(World&& other) noexcept;
  World& operator=(const World& other);
  World& operator=(World&& other) noexcept;
  ~World();
  /// Makes `snapshot` a copy for reading, as for publishing: every query but state_hash() gives the
  /// same answer. The memory of the methods, which is most of a copy, is left out. A snapshot that
  /// is stepped continues like a world that was saved and loaded. Cheapest into the last snapshot
  /// of the same world.
  void take_snapshot(World* snapshot) const;

  /// Options in force; visit_options() has units and ranges.
  const WorldOptions& options() const;
  /// Replaces all options from the next step on; wakes every island and restarts its method. Throws
  /// for options out of range, and for a time step that does not change time().
  void set_options(const WorldOptions& options);

  // ---- bodies

  /// Adds a body at `body.state` (world frame) and returns its id. Throws for settings out of range
  /// and for a name that another body has.
  BodyId add_body(const Body& body);
  /// Removes the body, its wrenches, every joint on it and every gear or pulley of such a joint.
  /// Returns the names of the removed joints, in the order of adding. Throws for the world itself.
  std::vector<std::string> remove_body(BodyId id);
  /// Whether a body has this name; the world itself is `world`.
  bool has_body(std::string_view name) const;
  /// Returns the body with this name, kWorldBody for `world`. Throws where there is none.
  BodyId find_body(std::string_view name) const;
  /// All bodies but the world, in the order of adding.
  std::vector<BodyId> body_ids() const;
  /// Writes all bodies but the world to `ids`, in the order of adding; reuses its memory.
  void body_ids(std::vector<BodyId>* ids) const;
  /// Settings of the body as it was added; reset() returns to `state` in them.
  const Body& body(BodyId id) const;
  /// Present pose [m] and twist [m/s, rad/s] of the body, world frame.
  const BodyState& state(BodyId id) const;
  /// Replaces mass, inertia, friction, restitution, `no_collision` and `gravity_compensation` of
  /// the body; its pose and velocity stay. Springs given by a frequency keep their stiffness.
  /// Throws for settings out of range, for the world itself, for another name or type, and for an
  /// inertia given to a point mass or taken from one that has it. Ignores shape and state of
  /// `body`.
  void set_body(BodyId id, const Body& body);
  /// Sets pose and twist of the body (world frame); its joints then close their new errors. Where a
  /// static or kinematic body keeps its pose, joints continue with their present closing. Throws
  /// for numbers that are not finite, for the world itself, and for a twist of a static body.
  void set_state(BodyId id, const BodyState& state);

  // ---- joints

  /// Adds a joint and returns its id. A rigid distance joint of length zero, given or measured, is
  /// added as a ball joint; a broken or disabled joint does not act. Throws for settings out of
  /// range, for a name in use, for ends that are the same body or both not dynamic, and for anchors
  /// or axes on a point mass without inertia. Throws for a gear or pulley whose joints do not
  /// exist, are the same, cannot be coupled, or do not act while it does.
  JointId add_joint(const Joint& joint, bool broken = false);
  /// Removes the joint. Throws where a gear or pulley couples it; remove the coupling first.
  void remove_joint(JointId id);
  /// Removes joints as remove_joint() and then bodies as remove_body(), in order, in time linear in
  /// the size of the world. Returns the names of the joints removed with the bodies, in the order
  /// of the bodies. Throws, and removes nothing, where a body or joint cannot be removed.
  std::vector<std::string> remove(const std::vector<JointId>& joints,
                                  const std::vector<BodyId>& bodies);
  /// Whether a joint has this name.
  bool has_joint(std::string_view name) const;
  /// Returns the joint with this name. Throws where there is none.
  JointId find_joint(std::string_view name) const;
  /// All joints, in the order of adding.
  const std::vector<JointId>& joint_ids() const;
  /// Settings of the joint as it was added, with length [m] and frames filled in, and a spring's
  /// frequency converted to stiffness [N/m] and damping [N s/m]. The motor is the present one.
  const Joint& joint(JointId id) const;
  /// Error [m], force [N], motor and closing of the joint, as of the last step or edit.
  const JointState& joint_state(JointId id) const;
  /// Anchors of a joint in the world frame [m].
  struct Anchors {
    Eigen::Vector3d p_a, p_b;
  };
  /// Returns the present anchors of the joint.
  Anchors anchors(JointId id) const;
  /// Wrench of a joint on body B, mean over the last step: force [N] and torque about anchor B [N
  /// m], in the joint's frame on B, or in body B's frame for kinds without axes. A gets the
  /// opposite at the same point. Laws and couplings of free coordinates are included. With
  /// redundant joints it is the solution of least norm. joint_wrench() throws for a gear or pulley,
  /// which acts along coordinates of other joints.
  struct JointWrench {
    Eigen::Vector3d force = Eigen::Vector3d::Zero(), torque = Eigen::Vector3d::Zero();
  };
  JointWrench joint_wrench(JointId id) const;
  /// Replaces the motor of the length, or of the first coordinate, of the joint; its timeout [s]
  /// counts from the present time. Throws for settings out of range, for a motor of a length by
  /// position or force, and for a joint without a coordinate to drive.
  void set_motor(JointId id, const Motor& motor);
  /// Replaces the motor of coordinate `coordinate` (from 0) of a joint with coordinates; none:
  /// the coordinate is free.
  void set_motor(JointId id, int coordinate, const std::optional<Motor>& motor);
  /// Replaces all laws of the coordinate. Without a `position` its value continues; an existing
  /// motor keeps its timeout. Throws for settings out of range.
  void set_law(JointId id, int coordinate, const CoordinateLaw& law);
  /// Replaces springs, limits, laws and motors of the joint, its break limits, `baumgarte`,
  /// `collide_connected` and `enabled`; closes the resulting error. A motor with changed settings
  /// begins its timeout anew, a new length excludes the motor's travel so far, and a frequency
  /// replaces existing stiffness and damping. Throws for settings out of range, and where name,
  /// kind, bodies, anchors or frames differ.
  void set_joint(JointId id, const Joint& joint);
  /// Breaks the joint, or repairs it and closes its present error.
  void set_broken(JointId id, bool broken);
  /// Disables the joint, so that it does not act, or enables it and closes its present error. While
  /// the joint is disabled, timeouts run on and whole turns are not counted; a velocity motor
  /// starts from the present coordinate. Bodies connected by a disabled joint may touch.
  void set_enabled(JointId id, bool enabled);

  // ---- wrenches

  /// Adds a wrench to the wrenches on its body: force [N] and torque [N m] along world axes, from
  /// `start` to `end` of simulated time [s]. The impulse is force times that interval, whatever the
  /// tick; an interval in the past adds nothing. Throws for a body that is not dynamic, a torque on
  /// a point mass without inertia, and an end that is not after the start.
  void add_wrench(const Wrench& wrench);
  /// Removes all wrenches of the body.
  void clear_wrenches(BodyId id);
  /// Pending and acting wrenches, in the order of adding.
  const std::vector<Wrench>& wrenches() const;

  // ---- motion

  /// Advances the world by a tick, `options().time_step` [s], and returns the report, which stays
  /// valid until the next call. Throws only where the system runs out of memory or threads, and
  /// keeps the state then.
  const StepReport& step();
  /// Report of the last step; all zero before the first step.
  const StepReport& report() const;
  /// Joint and cause of a step that failed by a function of another package (Failure::kCustom);
  /// else none, and empty. Snapshots as bytes leave both out.
  std::optional<JointId> failed_joint() const;
  std::string failed_why() const;
  /// Contact points of the last step (world frame, [m], [N]) in a stable order, islands at rest
  /// first. Empty between a reset or the removal of a body and the next step.
  const std::vector<Contact>& contacts() const;
  /// Events of the last step by time, simultaneous events in the order of islands. Islands by
  /// impulses report only joints that broke, at the end of the step. Empty between a failed step or
  /// a reset and the next step.
  const std::vector<Event>& events() const;
  double time() const;               ///< simulated time [s]
  std::uint64_t step_count() const;  ///< steps since time 0, or as set by set_time()
  /// Islands in the order of their first bodies. Methods and reasons are of the last step; after an
  /// edit, of the start of the next step.
  std::vector<Island> islands() const;
  /// Bodies that moved too fast for the time step in the last step, in the order of adding. Empty
  /// between an edit and the next step. On stiff islands h·ω > 2: errors may reach 1e-4 of a
  /// joint's length or more, while heavy bodies stay accurate. By energy_momentum: rotation that is
  /// off by more than 0.01 rad in a step. On joints by impulses: rotation of more than 2 rad in a
  /// step.
  std::vector<BodyId> unresolved_bodies() const;
  /// Joints that the last step found off by more than kUnclosedError [m] or kUnclosedAngle [rad]
  /// without being closed, in the order of adding. Empty between an edit and the next step.
  std::vector<JointId> unclosed_joints() const;
  /// Warnings of the last step: unclosed joints in the order of adding, then at most one of each
  /// other kind, in the order of StepWarning::Kind. Empty between an edit and the next step.
  std::vector<StepWarning> warnings() const;
  /// Present kinetic energy plus the potential energy of gravity (0 at the origin) and of springs
  /// [J].
  double energy() const;
  /// Returns every body and joint to the state in which it was added or loaded: pose, twist, motor,
  /// travel, broken, enabled. Timeouts count from the present time. Keeps bodies, joints, options
  /// and time, and clears wrenches; the phase of a sinusoidal motor stays a function of simulated
  /// time. set_time(0, 0) afterwards gives the motion of a new world, bit for bit. A joint that was
  /// added later closes the error it then has; a coupling that was added later is disabled or
  /// broken where a joint that it couples is.
  void reset();
  /// Sets simulated time [s] and step; timeouts and wrenches move along. Throws for a time that is
  /// not finite, or that adding a tick does not change.
  void set_time(double time, std::uint64_t step_count);
  /// Issues no id that `other` has issued, except ids of bodies and joints of this world.
  void reserve_ids(const World& other);
  /// Takes the place of `other`: continues its time and reuses none of its ids. All ids of this
  /// world change, and the phases of motors shift so that the motion equals the motion from time 0.
  void continue_from(const World& other);
  /// 64-bit FNV-1a hash of all that decides the motion: options without `threads`, step and time;
  /// by name, bodies and joints with their state and place in the order of adding; wrenches,
  /// contact impulses, memory of islands, and whether methods restart. Equal hashes mean equal
  /// futures, within a version of this library.
  std::uint64_t state_hash() const;
  /// Measures the stages of each following step with this clock; nullptr: not measured.
  void set_clock(Clock clock);
  /// Makes following steps poll this flag. Once it is set, a step ends early with `stopped` in the
  /// report and the state before it; nullptr: no flag. The flag must outlive the world.
  void set_stop_flag(StopFlag stop);
  /// Whether the stop flag exists and is set; for long edits that can be abandoned.
  bool is_asked_to_stop() const;

 private:
  struct Impl;
  friend struct ImplAccess;  // saves and loads a world
  std::unique_ptr<Impl> impl_;
};

}  // namespace constraint_sim::engine
