// Geometric queries of a world: World.ray, World.closest_points and World.bodies_in.

#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <optional>
#include <string>
#include <vector>

#include "constraint_sim/engine/closest_points.h"
#include "constraint_sim/engine/ray.h"
#include "constraint_sim/engine/region.h"
#include "python/definitions.h"
#include "python/keywords.h"
#include "python/parameters.h"

namespace constraint_sim::python {
namespace {

/// Reads the argument `ignored`: a sequence of names, frozen to a tuple.
std::vector<engine::BodyId> ignored_in(const engine::World& world, const py::object& names) {
  std::vector<engine::BodyId> ignored;
  if (!names) return ignored;
  if (!py::isinstance<py::tuple>(names))
    throw std::invalid_argument("ignored: must be a list of names of bodies");
  for (const py::handle name : names) {
    if (!py::isinstance<py::str>(name))
      throw std::invalid_argument("ignored: must be a list of names of bodies");
    ignored.push_back(world.find_body(name.cast<std::string>()));
  }
  return ignored;
}

}  // namespace

void define_geometry(WorldClass* world) {
  world->def(
      "ray",
      [](const SharedWorld& self, const py::object& origin, const py::object& direction,
         const py::kwargs& keywords) -> py::object {
        keywords["origin"] = origin;
        keywords["direction"] = direction;
        Keywords reading("ray", frozen(keywords));
        engine::Ray ray;
        reading.read("origin", &ray.origin);
        reading.read("direction", &ray.direction);
        reading.read("max_distance", &ray.max_distance);
        const py::object names = reading.find("ignored");
        reading.expect_no_more();
        const std::optional<engine::RayHit> hit =
            engine::cast_ray(self.read(), ray, ignored_in(self.read(), names));
        if (!hit) return py::none();
        const std::string body = body_name(self.read(), hit->body);
        py::dict dict;
        dict["body"] = body;
        dict["distance"] = hit->distance;
        dict["point"] = tuple_of(hit->point);
        dict["normal"] = tuple_of(hit->normal);
        dict["inside"] = hit->inside;
        return std::move(dict);
      },
      py::arg("origin"), py::arg("direction"),
      "ray(origin, direction, *, max_distance=inf [m], ignored=())\n\nThe first body that a ray "
      "hits, world frame; None without one. A dict of body, distance [m], point [m], normal, "
      "inside. The direction may have any length > 0. Every body with a shape is seen, with "
      "no_collision too, but those named in ignored. A ray that starts inside a body hits it at "
      "distance 0, with inside=True and a normal against the ray.");
  world->def(
      "closest_points",
      [](const SharedWorld& self, const std::string& body_a, const std::string& body_b) {
        const engine::World& read = self.read();
        const engine::ClosestPoints points =
            engine::closest_points(read, read.find_body(body_a), read.find_body(body_b));
        py::dict dict;
        dict["distance"] = points.distance;
        dict["point_a"] = tuple_of(points.p_a);
        dict["point_b"] = tuple_of(points.p_b);
        dict["normal"] = tuple_of(points.normal);
        return dict;
      },
      py::arg("body_a"), py::arg("body_b"),
      "Closest points of two bodies, world frame: a dict of distance [m], point_a and point_b on "
      "their surfaces [m], and normal, unit, from B to A. The distance of bodies that overlap is "
      "negative: the least translation that separates them.");
  world->def(
      "bodies_in",
      [](const SharedWorld& self, const py::object& min, const py::object& max) {
        py::dict arguments;
        arguments["min"] = min;
        arguments["max"] = max;
        Keywords reading("bodies_in", frozen(arguments));
        Eigen::Vector3d from, to;
        reading.read("min", &from);
        reading.read("max", &to);
        std::vector<std::string> names;
        for (const engine::BodyId id : engine::bodies_in(self.read(), from, to))
          names.push_back(self.read().body(id).name);
        return names;
      },
      py::arg("min"), py::arg("max"),
      "bodies_in(min, max)\n\nNames of the bodies whose bounding boxes along the world's axes "
      "share "
      "a point with the box between two corners [m], in the order of adding. A plane is the "
      "half-space below it.");
}

}  // namespace constraint_sim::python
