#pragma once

#include <stdexcept>
#include <string>
#include <vector>

#include "constraint_sim/engine/world.h"
#include "constraint_sim/engine/wrench.h"

namespace constraint_sim {

/// Changes of a world by inputs that drive bodies and joints, such as trajectories: few numbers
/// each, so that they can be recorded every tick. Bodies and joints are identified by name.
struct DriveChanges {
  struct Motor {
    std::string joint;
    bool has_coordinate = false;  ///< false: a distance joint
    engine::Motor motor;          ///< motor of the length or the first coordinate
  };
  struct State {
    std::string body;
    engine::BodyState state;
  };
  struct Wrench {
    std::string body;
    engine::Wrench wrench;
  };
  std::vector<Motor> motors;
  std::vector<State> states;
  std::vector<Wrench> wrenches;

  bool empty() const { return motors.empty() && states.empty() && wrenches.empty(); }
};

/// Sets motors, body states and wrenches of a world, and records each for a second world.
class Driver {
 public:
  /// `changes`: where the changes are recorded; null: nowhere.
  explicit Driver(engine::World* world, DriveChanges* changes = nullptr)
      : world_(world), changes_(changes) {}

  const engine::World& world() const { return *world_; }

  // The setters call the functions of the world with these names, which throw
  // std::invalid_argument.
  void set_motor(engine::JointId id, const engine::Motor& motor) {
    const bool has_coordinate = engine::info(world_->joint(id).kind).coordinates > 0;
    world_->set_motor(id, motor);
    if (changes_) changes_->motors.push_back({world_->joint(id).name, has_coordinate, motor});
  }
  void set_state(engine::BodyId id, const engine::BodyState& state) {
    world_->set_state(id, state);
    if (changes_) changes_->states.push_back({world_->body(id).name, state});
  }
  void add_wrench(const engine::Wrench& wrench) {
    world_->add_wrench(wrench);
    if (changes_) changes_->wrenches.push_back({world_->body(wrench.body).name, wrench});
  }

  /// Applies changes that were recorded in another world.
  void repeat(const DriveChanges& changes) {
    for (const DriveChanges::Motor& each : changes.motors) {
      const engine::JointId id = world_->find_joint(each.joint);
      if (each.has_coordinate != (engine::info(world_->joint(id).kind).coordinates > 0))
        throw std::invalid_argument("the motor of '" + each.joint + "' is of another kind");
      set_motor(id, each.motor);
    }
    for (const DriveChanges::State& each : changes.states)
      set_state(world_->find_body(each.body), each.state);
    for (DriveChanges::Wrench each : changes.wrenches) {
      each.wrench.body = world_->find_body(each.body);
      add_wrench(each.wrench);
    }
  }

 private:
  engine::World* world_;
  DriveChanges* changes_;
};

}  // namespace constraint_sim
