// Dynamics of robots for controllers: World.robot_dynamics and the class RobotDynamics.

#include "constraint_sim/engine/robot_dynamics.h"

#include <pybind11/eigen.h>
#include <pybind11/stl.h>

#include <optional>
#include <string>
#include <vector>

#include "python/definitions.h"
#include "python/keywords.h"
#include "python/parameters.h"

namespace constraint_sim::python {
namespace {

using Eigen::VectorXd;

/// A coordinate or follower with the name of its joint; none: of a free base.
struct NamedCoordinate {
  engine::RobotCoordinate is;
  std::optional<std::string> joint;
};
struct NamedFollower {
  engine::RobotFollower is;
  std::string joint;
};

/// Dynamics with the names of bodies and joints when they were read.
class NamedDynamics {
 public:
  NamedDynamics(const engine::World& world, const std::vector<std::string>& bodies)
      : dynamics_(world, ids_of(world, bodies)) {
    for (const engine::RobotCoordinate& coordinate : dynamics_.coordinates()) {
      std::optional<std::string> joint;
      if (coordinate.joint) joint = world.joint(*coordinate.joint).name;
      coordinates_.push_back({coordinate, joint});
    }
    for (const engine::RobotFollower& follower : dynamics_.followers())
      followers_.push_back({follower, world.joint(follower.joint).name});
    for (const engine::BodyId id : dynamics_.bodies()) bodies_.push_back(world.body(id).name);
  }

  const engine::RobotDynamics& get() const { return dynamics_; }
  const std::vector<NamedCoordinate>& coordinates() const { return coordinates_; }
  const std::vector<NamedFollower>& followers() const { return followers_; }
  const std::vector<std::string>& bodies() const { return bodies_; }
  /// Returns the body with this name. Throws where the robot has none.
  engine::BodyId body(const std::string& name) const {
    for (std::size_t i = 0; i < bodies_.size(); ++i)
      if (bodies_[i] == name) return dynamics_.bodies()[i];
    throw std::invalid_argument("body: must be a body of the robot of '" + bodies_.front() +
                                "', got '" + name + "'");
  }

 private:
  static std::vector<engine::BodyId> ids_of(const engine::World& world,
                                            const std::vector<std::string>& names) {
    std::vector<engine::BodyId> ids;
    for (const std::string& name : names) ids.push_back(world.find_body(name));
    return ids;
  }

  engine::RobotDynamics dynamics_;
  std::vector<NamedCoordinate> coordinates_;
  std::vector<NamedFollower> followers_;
  std::vector<std::string> bodies_;
};

/// Returns the numbers of a list, tuple or array of one dimension.
VectorXd numbers(const std::string& field, const py::object& values) {
  const bool is_text = PyUnicode_Check(values.ptr()) != 0 || PyBytes_Check(values.ptr()) != 0;
  const Py_ssize_t size =
      !is_text && PySequence_Check(values.ptr()) != 0 ? PySequence_Size(values.ptr()) : -1;
  if (size < 0) {
    PyErr_Clear();
    throw std::invalid_argument(field + ": must be a list of numbers");
  }
  VectorXd read(size);
  for (Py_ssize_t k = 0; k < size; ++k) {
    const auto value = py::reinterpret_steal<py::object>(PySequence_GetItem(values.ptr(), k));
    if (!value) throw py::error_already_set();
    read[k] = number(field + "[" + std::to_string(k) + "]", value);
  }
  return read;
}

py::dict coordinate_dict(const NamedCoordinate& named) {
  py::dict dict;
  dict["name"] = named.is.name;
  dict["joint"] = named.joint;
  dict["coordinate"] = named.is.coordinate < 0 ? py::none() : py::cast(named.is.coordinate);
  dict["is_angle"] = named.is.is_angle;
  dict["position"] = known(named.is.position);
  dict["velocity"] = named.is.velocity;
  return dict;
}

py::dict follower_dict(const NamedFollower& named) {
  py::dict dict;
  dict["joint"] = named.joint;
  dict["coordinate"] = named.is.coordinate;
  dict["leader"] = named.is.leader;
  dict["ratio"] = named.is.ratio;
  return dict;
}

using Class = py::class_<NamedDynamics>;

template <class Element, class ToDict>
void define_list(Class* dynamics, const char* name,
                 const std::vector<Element>& (NamedDynamics::*elements)() const, ToDict to_dict,
                 const char* doc) {
  dynamics->def_property_readonly(
      name,
      [=](const NamedDynamics& self) {
        py::list list;
        for (const Element& element : (self.*elements)()) list.append(to_dict(element));
        return list;
      },
      doc);
}

void define_quantities(Class* dynamics) {
  const auto define = [&](const char* name, auto get, const char* doc) {
    dynamics->def_property_readonly(
        name, [get](const NamedDynamics& self) { return get(self.get()); }, doc);
  };
  using Robot = engine::RobotDynamics;
  define_list(dynamics, "coordinates", &NamedDynamics::coordinates, coordinate_dict,
              "Coordinates in their order, dicts of name, joint (None: of a free base), coordinate "
              "of the joint (None: a motion without laws), is_angle, position [m or rad] (None for "
              "turns by three angles), velocity [m/s or rad/s].");
  define_list(dynamics, "followers", &NamedDynamics::followers, follower_dict,
              "Coordinates that follow others by couplings, dicts of joint, coordinate, "
              "leader (index in coordinates) and ratio of the rates.");
  dynamics->def_property_readonly("bodies", &NamedDynamics::bodies,
                                  "Names of the bodies in the order of adding.");
  define(
      "pose_error", [](const Robot& robot) { return robot.pose_error(); },
      "Largest error of a joint, which is left out: distance [m] plus angle [rad].");
  define(
      "position", [](const Robot& robot) { return robot.position(); },
      "Positions of the coordinates [m or rad], shape (n,); NaN for turns by three angles.");
  define(
      "velocity", [](const Robot& robot) { return robot.velocity(); },
      "Rates of the coordinates [m/s or rad/s], shape (n,).");
  define(
      "mass_matrix", [](const Robot& robot) { return robot.mass_matrix(); },
      "M, symmetric, shape (n, n) [kg, kg m or kg m^2].");
  define(
      "bias", [](const Robot& robot) { return robot.bias(); },
      "b: Coriolis and centrifugal forces, of a moving base, and gravity, shape (n,) [N or N "
      "m].");
  define(
      "gravity", [](const Robot& robot) { return robot.gravity(); },
      "Forces that carry the weights at rest, part of bias, shape (n,) [N or N m].");
  define(
      "passive", [](const Robot& robot) { return robot.passive(); },
      "p: forces of stiffness and damping of the coordinates, shape (n,) [N or N m].");
}

void define_functions(Class* dynamics) {
  dynamics->def(
      "motion_of",
      [](const NamedDynamics& self, const std::string& body, const py::object& point) {
        py::dict arguments;
        if (!point.is_none()) arguments["point"] = point;
        Keywords reading("motion_of", frozen(arguments));
        Eigen::Vector3d at = Eigen::Vector3d::Zero();
        reading.read("point", &at);
        const engine::RobotDynamics::PointMotion motion = self.get().motion_of(self.body(body), at);
        py::dict dict;
        dict["jacobian"] = motion.J;
        dict["velocity"] = VectorXd(motion.velocity);
        dict["bias"] = VectorXd(motion.bias);
        return dict;
      },
      py::arg("body"), py::arg("point") = py::none(),
      "motion_of(body, point=(0, 0, 0) [m] in the body's frame)\n\nMotion of a point fixed on a "
      "body, or of a frame there, in world axes, linear rows before angular ones: a dict of "
      "jacobian, shape (6, n), velocity, shape (6,) [m/s, rad/s], and bias, shape (6,) [m/s^2, "
      "rad/s^2]. The acceleration is jacobian @ qdd + bias.");
  dynamics->def(
      "inverse_dynamics",
      [](const NamedDynamics& self, const py::object& acceleration) {
        return self.get().inverse_dynamics(numbers("acceleration", acceleration));
      },
      py::arg("acceleration"),
      "inverse_dynamics(acceleration)\n\nForces M qdd + b - p [N or N m] for accelerations qdd "
      "[m/s^2 or rad/s^2], shape (n,).");
  dynamics->def(
      "forward_dynamics",
      [](const NamedDynamics& self, const py::object& force) {
        return self.get().forward_dynamics(numbers("force", force));
      },
      py::arg("force"),
      "forward_dynamics(force)\n\nAccelerations [m/s^2 or rad/s^2] by forces along the coordinates "
      "[N or N m], shape (n,).");
  dynamics->def(
      "linearize",
      [](const NamedDynamics& self, const py::object& force) {
        const engine::RobotDynamics::Linearization made =
            self.get().linearize(numbers("force", force));
        py::dict dict;
        dict["A"] = made.A;
        dict["B"] = made.B;
        dict["acceleration"] = made.acceleration;
        return dict;
      },
      py::arg("force"),
      "linearize(force)\n\nDerivatives at the present state and forces [N or N m], analytical: a "
      "dict of A, shape (2n, 2n), and B, shape (2n, n), with d/dt (dq, dqd) = A (dq, dqd) + B "
      "dforce, and the acceleration. Of turns by three angles dq is a rotation vector in axes of "
      "the body farther from the base.");
}

}  // namespace

void define_robot_dynamics(py::module* module, WorldClass* world) {
  Class dynamics(*module, "RobotDynamics",
                 "Dynamics M qdd + b = force + p of a robot at the state in which "
                 "World.robot_dynamics read it. Independent of the world.");
  define_quantities(&dynamics);
  define_functions(&dynamics);
  make_by_call_alone(dynamics);
  world->def(
      "robot_dynamics",
      [](const SharedWorld& self, const std::string& body) {
        return std::make_unique<NamedDynamics>(self.read(), std::vector<std::string>{body});
      },
      py::arg("body"));
  world->def(
      "robot_dynamics",
      [](const SharedWorld& self, const std::vector<std::string>& bodies) {
        return std::make_unique<NamedDynamics>(self.read(), bodies);
      },
      py::arg("body"),
      "robot_dynamics(body)\n\nRobotDynamics at the present state of the robot that has this "
      "dynamic "
      "body, or these: a list of names, such as `bodies` of add_urdf, of which those that are not "
      "dynamic are ignored. It has all bodies that acting joints connect. Motors, limits, "
      "friction, "
      "contacts and wrenches are left out. Raises ValueError naming joint or body where the joints "
      "form no tree.");
}

}  // namespace constraint_sim::python
