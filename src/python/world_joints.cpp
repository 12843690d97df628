// Joint functions of the class World.

#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <cmath>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "constraint_sim/engine/plan.h"
#include "python/definitions.h"
#include "python/keywords.h"
#include "python/parameters.h"

namespace constraint_sim::python {
namespace {

using Class = WorldClass;

py::dict joint_state_dict(const engine::Joint& joint, const engine::JointState& state) {
  py::dict dict;
  py::list coordinates;
  for (int i = 0; i < engine::info(joint.kind).coordinates; ++i) {
    const engine::CoordinateState& coordinate = state.coordinates[static_cast<std::size_t>(i)];
    py::dict each;
    each["position"] = coordinate.position;
    each["velocity"] = coordinate.velocity;
    each["effort"] = coordinate.effort;
    each["bias"] = coordinate.bias;
    coordinates.append(each);
  }
  dict["coordinates"] = coordinates;
  const bool has_error = std::isfinite(state.error);  // else the function of a custom joint fails
  dict["error"] = has_error ? py::object(py::float_(state.error)) : py::none();
  dict["error_rate"] = has_error ? py::object(py::float_(state.error_rate)) : py::none();
  dict["angle_error"] = state.angle_error;
  dict["force"] = state.force;
  dict["bias"] = state.bias;
  dict["reached_rate"] = state.reached_rate;
  dict["travel"] = state.travel;
  dict["saturated"] = state.saturated;
  dict["broken"] = state.broken;
  dict["closing"] = state.closing;
  return dict;
}

/// Sets the motor of a coordinate where the joint has coordinates, else the motor of its length.
void set_motor(engine::World* world, const std::string& name, const py::dict& keywords) {
  const engine::JointId id = world->find_joint(name);
  if (engine::info(world->joint(id).kind).coordinates == 0) {
    engine::Motor motor;
    velocity_motor_from(keywords, &motor);
    world->set_motor(id, motor);
    return;
  }
  const py::dict rest = keywords.attr("copy")();
  Keywords reading("set_motor", keywords);
  int coordinate = 0;
  bool removed = false;
  reading.read("coordinate", &coordinate);
  reading.read("removed", &removed);
  for (const char* key : {"coordinate", "removed"}) rest.attr("pop")(key, py::none());
  engine::Motor motor;
  motor_from(rest, &motor);
  if (removed && !rest.empty())
    throw std::invalid_argument("removed: a motor that is taken away has no settings");
  world->set_motor(id, coordinate, removed ? std::nullopt : std::optional(motor));
}

void define_list_of_joints(Class* world) {
  world->def(
      "add_joint",
      [](SharedWorld& self, const std::string& name, const py::kwargs& keywords) {
        keywords["name"] = name;
        const py::dict given = frozen(keywords);
        bool is_broken = false;
        const engine::Joint joint = joint_from(given, self.read(), &is_broken);
        self.edit([&](engine::World& edited) { edited.add_joint(joint, is_broken); });
      },
      py::arg("name"),
      "add_joint(name, *, type='distance', 'ball', 'hinge', 'slider', 'cylindrical', 'planar', "
      "'universal', 'weld', 'point_on_line', 'point_on_plane' or 'parallel', body_a='world', "
      "anchor_a=(0, 0, 0) [m] in the body's frame, body_b='world', anchor_b, for types with axes "
      "axis_a=(0, 0, 1) and axis_b or frame_a and frame_b (x, y, z, w), length=None [m] None: the "
      "present distance, "
      "min_length=0, max_length=inf [m], frequency [Hz] and damping_ratio, or stiffness [N/m] and "
      "damping [N s/m], one_sided=False True: a spring that only pulls, or a pulley whose rope may "
      "go slack, baumgarte=None, break_force=0 [N], break_torque=0 [N m], "
      "collide_connected=False, enabled=True, broken=False, motor={}; of types with free "
      "coordinates, for the "
      "first: lower, upper [m or rad], limit_restitution=0, friction, damping, stiffness, rest, "
      "frequency, damping_ratio, position, motor; or coordinates=[{...}, ...], these for each)"
      "\n\nAdds a joint; the motor's keywords are those of set_motor.");
  world->def(
      "remove_joint",
      [](SharedWorld& self, const std::string& name) {
        self.edit([&](engine::World& edited) { edited.remove_joint(edited.find_joint(name)); });
      },
      py::arg("name"), "Removes a joint.");
  world->def(
      "joint",
      [](const SharedWorld& self, const std::string& name) {
        const engine::World& read = self.read();
        const engine::JointId id = read.find_joint(name);
        const engine::Joint joint = read.joint(id);
        return joint_dict(joint, read, read.joint_state(id).broken);
      },
      py::arg("name"),
      "The joint with its length and stiffness filled in: the keywords of "
      "add_joint.");
  world->def_property_readonly(
      "joint_names",
      [](const SharedWorld& self) {
        py::list names;
        const std::vector<engine::JointId> ids = self.read().joint_ids();
        for (const engine::JointId id : ids) names.append(self.read().joint(id).name);
        return names;
      },
      "In the order of adding.");
}

void define_joint_states(Class* world) {
  world->def(
      "joint_state",
      [](const SharedWorld& self, const std::string& name) {
        const engine::JointId id = self.read().find_joint(name);
        const engine::Joint joint = self.read().joint(id);
        const engine::JointState state = self.read().joint_state(id);
        return joint_state_dict(joint, state);
      },
      py::arg("name"),
      "State after the last step: error [m], error_rate [m/s], angle_error [rad], force [N] along "
      "the joint, < 0 is tension, bias and reached_rate [m/s], travel of the motor [m], saturated, "
      "broken, closing, and coordinates, a list of those that are free: position, velocity, bias "
      "[m or rad, a second], effort [N or N m] of what acts along each. The errors of a custom "
      "joint are None where its function fails.");
  world->def(
      "joint_wrench",
      [](const SharedWorld& self, const std::string& name) {
        const engine::World::JointWrench wrench =
            self.read().joint_wrench(self.read().find_joint(name));
        py::dict dict;
        dict["force"] = tuple_of(wrench.force);
        dict["torque"] = tuple_of(wrench.torque);
        return dict;
      },
      py::arg("name"),
      "Wrench of the joint on body B, mean over the last step: force [N], and torque [N m] about "
      "anchor B, in the joint's frame on B, or in the body's frame for types without axes.");
  world->def(
      "opening",
      [](const SharedWorld& self, const std::string& name) {
        return engine::text_of_opening(self.read(), self.read().find_joint(name));
      },
      py::arg("name"), "How far a joint that closes is open now, in words; '' where it fits.");
}

void define_joint_settings(Class* world) {
  world->def(
      "set_motor",
      [](SharedWorld& self, const std::string& name, const py::kwargs& keywords) {
        const py::dict given = frozen(keywords);
        self.edit([&](engine::World& edited) { set_motor(&edited, name, given); });
      },
      py::arg("name"),
      "set_motor(name, *, bias=0 [m/s or rad/s] > 0 lengthens or turns positively about the axis, "
      "amplitude=0 [m/s or rad/s], frequency=0 [Hz], phase=0 [rad], max_force=0 [N or N m] 0: no "
      "limit, timeout=0 [s] 0: never), and of types with free coordinates coordinate=0, "
      "position=None [m or rad], servo_frequency=0 [Hz], servo_damping_ratio=1, servo_stiffness=0, "
      "servo_damping=0, force=None [N or N m], removed=False: free from now on\n\nReplaces the "
      "motor; its timeout counts from now.");
  world->def(
      "set_joint",
      [](SharedWorld& self, const std::string& name, const py::kwargs& keywords) {
        const py::dict given = frozen(keywords);
        return self.edit([&](engine::World& edited) {
          const engine::JointId id = edited.find_joint(name);
          engine::Joint joint = edited.joint(id);
          change_joint(given, &joint);
          edited.set_joint(id, joint);
          return engine::text_of_opening(edited, id);
        });
      },
      py::arg("name"),
      "set_joint(name, *, baumgarte, break_force, break_torque, collide_connected, enabled; of a "
      "distance joint length, min_length, max_length, frequency, damping_ratio, stiffness, "
      "damping, one_sided, "
      "motor; of types with free coordinates coordinate=0, and of that one lower, upper, "
      "limit_restitution, friction, damping, stiffness, rest, frequency, damping_ratio, position, "
      "motor={...} or None)\n\nSets the given settings and keeps the others; returns opening(): "
      "an error that the joint then has is closed.");
  world->def(
      "set_broken",
      [](SharedWorld& self, const std::string& name, bool is_broken) {
        self.edit(
            [&](engine::World& edited) { edited.set_broken(edited.find_joint(name), is_broken); });
      },
      py::arg("name"), py::arg("broken"), "Marks a joint as broken, or whole again.");
  world->def(
      "set_enabled",
      [](SharedWorld& self, const std::string& name, bool is_enabled) {
        return self.edit([&](engine::World& edited) {
          const engine::JointId id = edited.find_joint(name);
          edited.set_enabled(id, is_enabled);
          return engine::text_of_opening(edited, id);
        });
      },
      py::arg("name"), py::arg("enabled"),
      "Disables a joint, which then does not act, or enables it again, and returns opening(): an "
      "error that it then has is closed.");
}

}  // namespace

void define_joints(WorldClass* world) {
  define_list_of_joints(world);
  define_joint_states(world);
  define_joint_settings(world);
}

}  // namespace constraint_sim::python
