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
#include "constraint_sim/engine/wrench.h"

namespace constraint_sim::engine {

/// A clock: the time since any origin [s].
using Clock = double (*)();

/// Bodies, joints and their motion, in SI units; the world frame is right-handed.
///
/// A value: a copy continues with the same bits. Every function that takes an argument checks it
/// first: bad input throws std::invalid_argument("FIELD: why, with the value") and changes nothing.
/// An id that this world has not handed out, or whose body or joint has been removed, is bad input.
/// step() does not throw for physics: it reports. References stay valid until the next call that is
/// not const.
class World {
 public:
  /// A world without bodies, at time 0. Throws for options out of range.
  explicit World(const WorldOptions& options = {});
  World(const World& other);
  World(World&& other) noexcept;
  World& operator=(const World& other);
  World& operator=(World&& other) noexcept;
  ~World();
  /// Makes `snapshot` a copy to look at, as for publishing: all questions have the same answers but
  /// state_hash(). What methods go on from is left out, which is most of a copy, so that a snapshot
  /// that is stepped goes on as a world that was saved and loaded. Cheapest into the last snapshot
  /// of the same world.
  void take_snapshot(World* snapshot) const;

  /// Options in force; units and ranges are those of visit_options().
  const WorldOptions& options() const;
  /// Replaces all options from the next step on; wakes every island and restarts its method. Throws
  /// for options out of range, and for a time step that is lost beside time().
  void set_options(const WorldOptions& options);

  // ---- bodies

  /// Adds a body at `body.state` (world frame) and returns its id. Throws for settings out of range
  /// and for a name that another body has.
  BodyId add_body(const Body& body);
  /// Removes the body, its wrenches, every joint on it and every gear or pulley of one of these;
  /// returns the names of those joints, in the order of adding. Throws for the world itself.
  std::vector<std::string> remove_body(BodyId id);
  /// Whether a body has this name; the world itself has `world`.
  bool has_body(std::string_view name) const;
  /// The body with this name, kWorldBody for `world`. Throws where there is none.
  BodyId find_body(std::string_view name) const;
  /// All bodies but the world, in the order of adding.
  std::vector<BodyId> body_ids() const;
  /// The same into `ids`, whose memory is used again.
  void body_ids(std::vector<BodyId>* ids) const;
  /// Settings of the body as it was added; `state` in them is the one that reset() returns to.
  const Body& body(BodyId id) const;
  /// Pose [m] and twist [m/s, rad/s] of the body now, world frame.
  const BodyState& state(BodyId id) const;
  /// Replaces mass, inertia, friction, restitution and `no_collision` of the body, in motion and
  /// at rest: its velocity stays. Springs given by a frequency keep their stiffness. Throws for
  /// settings out of range, for the world itself, for another name or type, and for an inertia
  /// given to a point mass or taken from one that has it. Shape and state of `body` are not looked
  /// at.
  void set_body(BodyId id, const Body& body);
  /// Places the body there, at that twist (world frame), and lets its joints close what they are
  /// then off by; with a static or kinematic body that stays where it is they go on with that.
  /// Throws for numbers that are not finite, for the world itself, and for a static
  /// body that is to move.
  void set_state(BodyId id, const BodyState& state);

  // ---- joints

  /// Adds a joint and returns its id. A rigid distance joint of length zero, given or measured, is
  /// added as a ball joint; a broken or disabled joint does not act. Throws for settings out of
  /// range, for a name that another joint has, for ends that are one body or not dynamic, and for
  /// anchors or axes on a point mass without inertia; and for a gear or pulley whose joints are not
  /// there, are one, cannot be coupled, or do not act while it does.
  JointId add_joint(const Joint& joint, bool broken = false);
  /// Removes the joint. Throws where a gear or pulley couples it; remove that first.
  void remove_joint(JointId id);
  /// Removes joints as remove_joint() and then bodies as remove_body(), each in its order, at a
  /// cost that is linear in the size of the world; returns the names of the joints that went with
  /// the bodies, in the order of the bodies. Where one of them cannot be removed, throws and
  /// removes none.
  std::vector<std::string> remove(const std::vector<JointId>& joints,
                                  const std::vector<BodyId>& bodies);
  /// Whether a joint has this name.
  bool has_joint(std::string_view name) const;
  /// The joint with this name. Throws where there is none.
  JointId find_joint(std::string_view name) const;
  /// All joints, in the order of adding.
  const std::vector<JointId>& joint_ids() const;
  /// Settings of the joint as it was added, with its length [m] and its frames filled in, and a
  /// spring's frequency turned into stiffness [N/m] and damping [N s/m]; the motor is the present
  /// one.
  const Joint& joint(JointId id) const;
  /// Error [m], force [N], motor and closing of the joint, as of the last step or edit.
  const JointState& joint_state(JointId id) const;
  /// Both anchors of a joint in the world frame [m].
  struct Anchors {
    Eigen::Vector3d p_a, p_b;
  };
  /// Anchors of the joint now.
  Anchors anchors(JointId id) const;
  /// What a joint does to body B, mean over the last step: force [N], and torque about anchor B
  /// [N m], in the joint's frame on B; of kinds without axes in that of body B. On A it does the
  /// opposite at the same point. Along free coordinates it is what laws and couplings do. With
  /// redundant joints, that of least norm of many. Throws for a gear or pulley, which acts along
  /// coordinates of others.
  struct JointWrench {
    Eigen::Vector3d force = Eigen::Vector3d::Zero(), torque = Eigen::Vector3d::Zero();
  };
  JointWrench joint_wrench(JointId id) const;
  /// Replaces the motor of the joint; its timeout [s] counts from now. Throws for settings out of
  /// range, and for a joint that has nothing to drive. Of
  /// kinds with coordinates() that of the first.
  void set_motor(JointId id, const Motor& motor);
  /// The same of one of the coordinates() of a joint of another kind than kDistance, numbered from
  /// 0; without a motor it is free.
  void set_motor(JointId id, int coordinate, const std::optional<CoordinateMotor>& motor);
  /// Replaces all that acts on the coordinate. Without a `position` it reads on as it did; a motor
  /// that was there keeps its timeout. Throws for settings out of range.
  void set_law(JointId id, int coordinate, const CoordinateLaw& law);
  /// Replaces springs, limits, laws and motors of the joint, what it breaks at, `baumgarte`,
  /// `collide_connected` and `enabled`, at once; what it is then off by is closed. A motor whose
  /// settings change begins its timeout now, a new length counts without what a motor has added,
  /// and a frequency replaces the stiffness and damping that were there. Throws for settings out of
  /// range, and where name, kind, bodies, anchors or frames are others.
  void set_joint(JointId id, const Joint& joint);
  /// Breaks the joint, or repairs it: an error that it then has is closed.
  void set_broken(JointId id, bool broken);
  /// Disables the joint, which then does not act, or enables it again: an error that it then has is
  /// closed. Meanwhile timeouts run on and whole turns are not counted; a motor by velocity starts
  /// from where the coordinate is. Bodies that a disabled joint connects may touch.
  void set_enabled(JointId id, bool enabled);

  // ---- wrenches

  /// Adds a wrench to those that act on its body: force [N] and torque [N m] along world axes, from
  /// `start` to `end` of simulated time [s]. The impulse is force times that interval, whatever the
  /// tick; an interval that is over already adds nothing. Throws for a body that is not dynamic, a
  /// torque on a point mass without inertia, and an end that is not after the start.
  void add_wrench(const Wrench& wrench);
  /// Removes all wrenches of the body.
  void clear_wrenches(BodyId id);
  /// Wrenches that are pending or acting, in the order of adding.
  const std::vector<Wrench>& wrenches() const;

  // ---- motion

  /// Advances the world by one tick, `options().time_step` [s], and reports what that did. The
  /// report stays valid until the next call. Throws only what the system throws where memory or
  /// threads run out; the state is then that of before.
  const StepReport& step();
  /// Report of the last step; before the first one all zero.
  const StepReport& report() const;
  /// Where a step failed by functions of another package (Failure::kCustom): whose they are, and
  /// what they did, with names; else none, and empty. Not in snapshots as bytes.
  std::optional<JointId> failed_joint() const;
  std::string failed_why() const;
  /// Contact points of the last step (world frame, [m], [N]) in a stable order, those of islands at
  /// rest before all others; none between a reset or the removal of a body and the next step.
  const std::vector<Contact>& contacts() const;
  /// What happened within the last step, by time; at the same time in the order of islands. What
  /// impulses carry has no moments but joints that broke, at the end of the step. Empty between a
  /// failed step or a reset and the next step.
  const std::vector<Event>& events() const;
  double time() const;               ///< simulated time [s]
  std::uint64_t step_count() const;  ///< steps since time 0, or as set_time() says
  /// Islands in the order of their first bodies; methods and reasons are those of the last step,
  /// and after an edit those that the next step begins with.
  std::vector<Island> islands() const;
  /// Bodies whose motion the last step was too long to show, in the order of adding; none between
  /// an edit and the next step. On stiff islands h·ω > 2: such bodies may be off by 1e-4 of a
  /// joint's length or more, while heavy ones are not. Where impulses advance joints, bodies that
  /// rotate by more than 2 rad in a step.
  std::vector<BodyId> unresolved_bodies() const;
  /// Joints that the last step found off by more than kUnclosedError [m] or kUnclosedAngle [rad]
  /// and not being closed, in the order of adding; none between an edit and the next step.
  std::vector<JointId> unclosed_joints() const;
  /// First body of the island whose energy has risen without a cause, as of the last step; none
  /// between an edit and the next step.
  std::optional<BodyId> gaining_body() const;
  /// StepReport::hits_left_body of the last step; none between an edit and the next step.
  std::optional<BodyId> hits_left_body() const;
  /// Whether StepReport::overlap_body and creep_body of the last step are bodies of this world: not
  /// between an edit and the next step.
  bool has_reported_contacts() const;
  /// Kinetic energy plus the potential energy of gravity (0 at the origin) and of springs [J], now.
  double energy() const;
  /// Returns every body and joint to the state it was added or loaded with: pose, twist, motor,
  /// travel, broken, enabled; timeouts count from now. Adds and removes no body and no joint,
  /// clears wrenches, keeps options, and lets time go on; a motor's sinusoid stays one of simulated
  /// time. set_time(0, 0) afterwards makes the motion that of a new world, bit for bit. A joint
  /// that was added later, and that its bodies then do not fit, is closed.
  void reset();
  /// Continues from this simulated time [s] and step; timeouts and wrenches move along. Throws for
  /// a time that is not finite, or to which adding a tick changes nothing.
  void set_time(double time, std::uint64_t step_count);
  /// Hands out no id that `other` has handed out, but for those of bodies and joints that are here.
  void reserve_ids(const World& other);
  /// Takes the place of `other`: continues its time, and uses none of its ids again. All ids of
  /// this world change, and the phases of motors shift so that the motion is the same as from 0.
  void continue_from(const World& other);
  /// 64-bit FNV-1a hash of all that decides the motion: options but for `threads`, step and time;
  /// by name, bodies and joints with their state and place in the order of adding; wrenches,
  /// contact impulses, what islands remember, and whether methods restart. Equal hashes mean equal
  /// futures, within one version of this library.
  std::uint64_t state_hash() const;
  /// Times the stages of each step by this clock from now on; nullptr: no longer.
  void set_clock(Clock clock);
  /// Makes steps look at this flag from now on and, once it is set, end early with `stopped` in the
  /// report and the state of before; nullptr: no longer. The flag must outlive the world.
  void set_stop_flag(StopFlag stop);
  /// Whether the stop flag is there and set: for edits that take long and can be given up.
  bool is_asked_to_stop() const;

 private:
  struct Impl;
  friend struct Insides;  // of saving and loading
  std::unique_ptr<Impl> impl_;
};

}  // namespace constraint_sim::engine
