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
#include "constraint_sim/engine/id.h"
#include "constraint_sim/engine/island.h"
#include "constraint_sim/engine/joint.h"
#include "constraint_sim/engine/options.h"
#include "constraint_sim/engine/report.h"
#include "constraint_sim/engine/stop_flag.h"
#include "constraint_sim/engine/wrench.h"

namespace constraint_sim::engine {

/// Time in seconds from any origin.
using Clock = double (*)();

/// Bodies, joints and their motion. A value: a copy goes on bit-identically. Bad input to any
/// function throws std::invalid_argument naming field and value, and changes nothing; step() never
/// throws for physics, it reports.
class World {
 public:
  explicit World(const WorldOptions& options = {});
  World(const World& other);
  World(World&& other) noexcept;
  World& operator=(const World& other);
  World& operator=(World&& other) noexcept;
  ~World();

  const WorldOptions& options() const;
  void set_options(const WorldOptions& options);

  // ---- bodies
  BodyId add_body(const Body& body);
  /// Removes the body and every joint on it; returns the names of those joints.
  std::vector<std::string> remove_body(BodyId id);
  bool has_body(std::string_view name) const;
  BodyId find_body(std::string_view name) const;
  /// In the order of adding, without the world.
  std::vector<BodyId> body_ids() const;
  const Body& body(BodyId id) const;
  const BodyState& state(BodyId id) const;
  void set_state(BodyId id, const BodyState& state);

  // ---- joints
  /// A distance joint of length zero, asked for or found, becomes a ball joint. A broken one does
  /// not act.
  JointId add_joint(const Joint& joint, bool broken = false);
  void remove_joint(JointId id);
  bool has_joint(std::string_view name) const;
  JointId find_joint(std::string_view name) const;
  /// In the order of adding.
  const std::vector<JointId>& joint_ids() const;
  /// As added, with the length filled in and springs turned into stiffness and damping.
  const Joint& joint(JointId id) const;
  const JointState& joint_state(JointId id) const;
  /// Both anchors in world coordinates [m].
  struct Anchors {
    Eigen::Vector3d p_a, p_b;
  };
  Anchors anchors(JointId id) const;
  /// What a joint does to body B, mean over the last step: force [N], and torque about anchor B
  /// [N m], in the joint's frame on B; of kinds without axes in that of body B. On A it does the
  /// opposite at the same point. With redundant joints, that of least norm of many.
  struct JointWrench {
    Eigen::Vector3d force = Eigen::Vector3d::Zero(), torque = Eigen::Vector3d::Zero();
  };
  JointWrench joint_wrench(JointId id) const;
  /// Replaces the motor; its timeout counts from now.
  void set_motor(JointId id, const Motor& motor);
  /// The same of one of the coordinates() of a joint of another kind than kDistance, numbered from
  /// 0; without a motor it is free.
  void set_motor(JointId id, int coordinate, const std::optional<CoordinateMotor>& motor);
  /// Marks the joint as torn, or whole again.
  void set_broken(JointId id, bool broken);

  // ---- wrenches
  /// Several on one body add up; removing the body removes them. The impulse is force times the
  /// time in the span, whatever the tick. One whose span is over already adds nothing.
  void add_wrench(const Wrench& wrench);
  void clear_wrenches(BodyId id);
  /// Those that are still pending or acting, in the order of adding.
  const std::vector<Wrench>& wrenches() const;

  // ---- motion
  /// Carries the world on by one tick. The report stays valid until the next call. Where memory or
  /// threads run out it throws what the system did, and the state is that of before.
  const StepReport& step();
  const StepReport& report() const;
  /// Contact points that the last step met, those of islands at rest before all others, in a stable
  /// order.
  const std::vector<Contact>& contacts() const;
  double time() const;               ///< simulated [s]
  std::uint64_t step_count() const;  ///< since the start
  /// In the order of their first bodies; methods and reasons as of the last step, before the first
  /// one as it will begin.
  std::vector<Island> islands() const;
  /// Of stiff islands, those whose motion the last step was too long to show, h·ω > 2: they may be
  /// off by 1e-4 of a joint's length or more, while what is heavy is not. Where impulses carry
  /// joints, those that turn by more than 2 rad in a step. In the order of adding; none between an
  /// edit and the next step.
  std::vector<BodyId> unresolved_bodies() const;
  /// Joints that the last step found off by more than kUnclosedError and not being closed, in the
  /// order of adding; none between an edit and the next step.
  std::vector<JointId> unclosed_joints() const;
  /// The first body of the island whose energy has risen without a cause, as of the last step; none
  /// between an edit and the next step.
  std::optional<BodyId> gaining_body() const;
  /// Kinetic energy plus that of gravity and springs [J], now.
  double energy() const;
  /// Every body and joint returns to what it was when added or loaded: state, motor, travel, torn
  /// or whole; timeouts count from now. None is added or removed, wrenches go, options stay, and
  /// time goes on; a motor's sinusoid is one of simulated time, as ever. set_time(0, 0) afterwards
  /// makes the motion that of a new world, bit for bit. Where a joint with axes was added after its
  /// bodies had turned, its orientation is closed; refused where it would be off by more than
  /// 0.5 rad.
  void reset();
  /// Goes on from this simulated time [s] and step; timeouts and wrenches move along. A time to
  /// which adding a tick changes nothing is refused.
  void set_time(double time, std::uint64_t step_count);
  /// Takes over from another world: its time goes on, and its ids are not used again. All ids of
  /// this world change, and the phases of motors shift so that the motion is the same as from 0.
  void continue_from(const World& other);
  /// 64-bit FNV-1a over all that decides the motion: options but for `threads`, step and time, and
  /// by name bodies and joints with their state and place in the order of adding, wrenches, contact
  /// impulses, what islands remember, and whether methods begin anew. Equal hashes mean equal
  /// futures.
  std::uint64_t state_hash() const;
  /// Times the stages of each step from now on; nullptr: no longer.
  void set_clock(Clock clock);
  /// Steps look at this flag from now on and, once it is set, end early with `stopped` in the
  /// report and the state of before; nullptr: no longer. It must outlive the world.
  void set_stop_flag(StopFlag stop);

 private:
  struct Impl;
  friend struct Insides;  // of saving and loading
  std::unique_ptr<Impl> impl_;
};

}  // namespace constraint_sim::engine
