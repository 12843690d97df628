// Robots from URDFs: World.add_urdf and World.add_urdf_file.

#include <pybind11/stl.h>

#include <array>
#include <stdexcept>
#include <string>

#include "python/definitions.h"
#include "sim/files.h"

#ifdef CONSTRAINT_SIM_URDF
#include "urdf/robot.h"
#endif

namespace constraint_sim::python {
namespace {

/// Arguments of both functions.
struct RobotArguments {
  std::string prefix;
  std::array<double, 3> position;
  std::array<double, 4> orientation;
  bool fixed = false;
  std::string extra;
};

#ifdef CONSTRAINT_SIM_URDF

/// Returns links with their body and pose in it.
py::dict links_dict(const Robot& robot, const engine::World& world) {
  py::dict links;
  for (const RobotLink& link : robot.links) {
    const Eigen::Vector3d& p = link.in_body.translation();
    const Eigen::Quaterniond q(link.in_body.linear());
    links[py::str(link.name)] =
        py::dict(py::arg("body") = world.body(link.body).name,
                 py::arg("position") = py::make_tuple(p.x(), p.y(), p.z()),
                 py::arg("orientation") = py::make_tuple(q.x(), q.y(), q.z(), q.w()));
  }
  return links;
}

py::dict add_robot_of(SharedWorld* shared, const std::string& text, const std::string& folder,
                      const std::string& srdf, const RobotArguments& given) {
  RobotOptions options;
  options.prefix = given.prefix;
  options.pose.position = Eigen::Vector3d(given.position.data());
  const auto& [x, y, z, w] = given.orientation;
  options.pose.orientation = Eigen::Quaterniond(w, x, y, z);
  options.fixed = given.fixed;
  options.extra = given.extra;
  options.srdf = srdf;
  options.folder = folder;
  options.how_to_expand = "`xacro FILE > expanded.urdf` expands it";
  const BuiltRobot built = build_robot(text, options);
  return shared->edit([&](engine::World& edited) {
    const Robot robot = add_robot(built, &edited);
    py::dict added;
    added["name"] = robot.name;
    added["bodies"] = robot.bodies;
    added["constraints"] = robot.constraints;
    added["links"] = links_dict(robot, edited);
    added["fixed_joints"] = robot.fixed_joints;
    added["warnings"] = robot.warnings;
    return added;
  });
}

#else

py::dict add_robot_of(SharedWorld* /*shared*/, const std::string& /*text*/,
                      const std::string& /*folder*/, const std::string& /*srdf*/,
                      const RobotArguments& /*given*/) {
  throw std::runtime_error("this module was built without urdfdom, which reads URDFs");
}

#endif

/// Returns the text of a file beside another one; empty where there is none.
std::string text_beside(const std::string& path, const std::string& ending) {
  const std::size_t dot = path.rfind('.');
  const bool has_ending = dot != std::string::npos && path.find('/', dot) == std::string::npos;
  const py::object file = py::module::import("pathlib").attr("Path")(path.substr(0, dot) + ending);
  return has_ending && py::cast<bool>(file.attr("is_file")()) ? read_file(py::str(file)) : "";
}

}  // namespace

void define_robots(WorldClass* world) {
  world->def(
      "add_urdf",
      [](SharedWorld& self, const std::string& text, const std::string& prefix,
         const std::array<double, 3>& position, const std::array<double, 4>& orientation,
         bool is_fixed, const std::string& extra, const std::string& srdf) {
        return add_robot_of(&self, text, "", srdf,
                            {prefix, position, orientation, is_fixed, extra});
      },
      py::arg("text"), py::arg("prefix") = "", py::arg("position") = std::array<double, 3>{},
      py::arg("orientation") = std::array<double, 4>{0.0, 0.0, 0.0, 1.0}, py::arg("fixed") = false,
      py::arg("extra") = "", py::arg("srdf") = "",
      "add_urdf(text, prefix='', position=(0, 0, 0) [m], orientation=(0, 0, 0, 1) x y z w, "
      "fixed=False, extra='', srdf='')\n\nAdds the robot of a URDF or an SDF; `extra` is the YAML "
      "of "
      "docs/robots.md. Returns a dict of its name, the names of bodies and constraints, links by "
      "name with body, position [m] and orientation in the body, fixed_joints that move no mass, "
      "and warnings: all that deviates from the URDF. Raises ValueError and adds nothing where the "
      "robot is rejected.");
  world->def(
      "add_urdf_file",
      [](SharedWorld& self, const std::string& path, const std::string& prefix,
         const std::array<double, 3>& position, const std::array<double, 4>& orientation,
         bool is_fixed, const std::optional<std::string>& extra) {
        const py::object file = py::module::import("pathlib").attr("Path")(path);
        const std::string folder = py::str(file.attr("resolve")().attr("parent"));
        return add_robot_of(
            &self, read_file(path), folder, text_beside(path, ".srdf"),
            {prefix, position, orientation, is_fixed, extra ? *extra : text_beside(path, ".yaml")});
      },
      py::arg("path"), py::arg("prefix") = "", py::arg("position") = std::array<double, 3>{},
      py::arg("orientation") = std::array<double, 4>{0.0, 0.0, 0.0, 1.0}, py::arg("fixed") = false,
      py::arg("extra") = py::none(),
      "add_urdf_file(path, prefix='', position=(0, 0, 0) [m], orientation=(0, 0, 0, 1) x y z w, "
      "fixed=False, extra=None)\n\nThe same of a file, with the .yaml and .srdf of the same name "
      "beside it; an `extra` replaces the YAML.");
}

}  // namespace constraint_sim::python
