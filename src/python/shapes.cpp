#include <pybind11/pybind11.h>

#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "constraint_sim/engine/shape.h"
#include "python/definitions.h"
#include "python/keywords.h"
#include "python/parameters.h"

namespace constraint_sim::python {

namespace {

/// Returns a part from a shape, or from a tuple of a shape, its pose and the surface.
engine::ShapePart part_from(const py::object& value) {
  if (!py::isinstance<py::tuple>(value) && !py::isinstance<py::list>(value))
    return {shape_from(value), {}};
  const auto items = py::tuple(value);
  if (items.size() < 2 || items.size() > 3)
    throw std::invalid_argument("must be a shape, or a shape, its pose and its surface, got " +
                                std::to_string(items.size()) + " values");
  engine::ShapePart part{shape_from(items[0]), {}};
  part.pose = shape_pose_from(items[1]).value_or(engine::ShapePose{});
  if (items.size() == 2) return part;
  Keywords surface("surface", py::dict(items[2]));
  surface.read("friction", &part.friction);
  surface.read("restitution", &part.restitution);
  surface.expect_no_more();
  return part;
}

py::dict surface_dict(const engine::ShapePart& part) {
  py::dict surface;
  if (part.friction) surface["friction"] = *part.friction;
  if (part.restitution) surface["restitution"] = *part.restitution;
  return surface;
}

void define_compound(py::module* module) {
  py::class_<engine::Compound>(
      *module, "Compound",
      "Compound(shapes)\n\nSeveral spheres, boxes, cylinders, capsules and hulls of one body, a "
      "list of shapes, of pairs (shape, shape_pose), or of triples (shape, shape_pose, surface), "
      "the surface a dict with friction and restitution where these are not the body's; at most "
      "4096.")
      .def(py::init([](const py::iterable& shapes) {
             engine::Compound::Parts parts;
             for (const py::handle shape : shapes) {
               try {
                 parts.push_back(part_from(py::reinterpret_borrow<py::object>(shape)));
               } catch (const std::invalid_argument& error) {
                 throw std::invalid_argument("shapes[" + std::to_string(parts.size()) +
                                             "]: " + error.what());
               }
               if (parts.size() > engine::kMostParts) break;  // rejected, may have no end
             }
             return engine::Compound(std::move(parts));
           }),
           py::arg("shapes"))
      .def_property_readonly(
          "shapes",
          [](const engine::Compound& compound) {
            py::list list;
            for (const engine::ShapePart& part : *compound.parts)
              list.append(
                  py::make_tuple(part.shape, shape_pose_dict(part.pose), surface_dict(part)));
            return list;
          },
          "triples of each shape, its pose, a dict of position [m] and orientation (x, y, z, w), "
          "and its surface, a dict with the friction and restitution that are not the body's")
      .def("__repr__", [](const engine::Compound& compound) {
        return "Compound(" + std::to_string(compound.parts->size()) + " shapes)";
      });
}

}  // namespace

void define_shapes(py::module* module) {
  py::class_<engine::Point>(*module, "Point",
                            "Point()\n\nTouches nothing, and rotates only with an inertia.")
      .def(py::init<>())
      .def("__repr__", [](const engine::Point&) { return "Point()"; });
  py::class_<engine::Sphere>(*module, "Sphere",
                             "Sphere(radius)\n\nCentred on the body; radius [m] > 0.")
      .def(py::init(
               [](const py::object& radius) { return engine::Sphere{number("radius", radius)}; }),
           py::arg("radius"))
      .def_readonly("radius", &engine::Sphere::radius, "[m]")
      .def("__repr__", [](const engine::Sphere& sphere) {
        return "Sphere(" + std::string(py::str(py::float_(sphere.radius))) + ")";
      });
  py::class_<engine::Box>(
      *module, "Box",
      "Box(size)\n\nCentred on the body, whole edge lengths along its axes [m] > 0.")
      .def(py::init([](const py::object& size) {
             py::dict dict;
             dict["size"] = size;
             engine::Box box;
             Keywords("Box", dict).read("size", &box.size);
             return box;
           }),
           py::arg("size"))
      .def_property_readonly(
          "size", [](const engine::Box& box) { return tuple_of(box.size); }, "[m]")
      .def("__repr__", [](const engine::Box& box) {
        return "Box(" + std::string(py::str(tuple_of(box.size))) + ")";
      });
  py::class_<engine::Plane>(*module, "Plane",
                            "Plane()\n\nSolid below the body's x-y plane; static and kinematic "
                            "bodies only.")
      .def(py::init<>())
      .def("__repr__", [](const engine::Plane&) { return "Plane()"; });
  py::class_<engine::Cylinder>(
      *module, "Cylinder",
      "Cylinder(radius, length)\n\nCentred on the body, along its z axis, with flat ends; radius "
      "and length [m] > 0.")
      .def(py::init([](const py::object& radius, const py::object& length) {
             return engine::Cylinder{number("radius", radius), number("length", length)};
           }),
           py::arg("radius"), py::arg("length"))
      .def_readonly("radius", &engine::Cylinder::radius, "[m]")
      .def_readonly("length", &engine::Cylinder::length, "[m]")
      .def("__repr__", [](const engine::Cylinder& cylinder) {
        return "Cylinder(" + std::string(py::str(py::float_(cylinder.radius))) + ", " +
               std::string(py::str(py::float_(cylinder.length))) + ")";
      });
  py::class_<engine::Capsule>(
      *module, "Capsule",
      "Capsule(radius, length)\n\nCentred on the body, along its z axis: a cylinder with half "
      "spheres as ends; radius and length of the cylinder [m] > 0.")
      .def(py::init([](const py::object& radius, const py::object& length) {
             return engine::Capsule{number("radius", radius), number("length", length)};
           }),
           py::arg("radius"), py::arg("length"))
      .def_readonly("radius", &engine::Capsule::radius, "[m]")
      .def_readonly("length", &engine::Capsule::length,
                    "between the centres of the half spheres [m]")
      .def("__repr__", [](const engine::Capsule& capsule) {
        return "Capsule(" + std::string(py::str(py::float_(capsule.radius))) + ", " +
               std::string(py::str(py::float_(capsule.length))) + ")";
      });
  py::class_<engine::Hull>(
      *module, "Hull",
      "Hull(vertices)\n\nConvex hull of points [m], a list of (x, y, z), by Qhull; at most 100000 "
      "points and 512 vertices.")
      .def(py::init([](const py::iterable& vertices) {
             std::vector<Eigen::Vector3d> points;
             for (const py::handle vertex : vertices) {
               py::dict dict;
               dict["vertices"] = vertex;
               Keywords("Hull", dict).read("vertices", &points.emplace_back());
               if (points.size() > engine::kMostHullPoints) break;  // rejected, may have no end
             }
             return engine::Hull(points);
           }),
           py::arg("vertices"))
      .def_property_readonly(
          "vertices",
          [](const engine::Hull& hull) {
            py::list list;
            for (const Eigen::Vector3d& vertex : hull.surface->vertices())
              list.append(tuple_of(vertex));
            return list;
          },
          "[m]")
      .def_property_readonly(
          "faces",
          [](const engine::Hull& hull) {
            py::list list;
            for (const engine::ConvexHull::Face& face : hull.surface->faces()) {
              py::list corners;
              for (int k = 0; k < face.count; ++k)
                corners.append(
                    hull.surface->corners()[static_cast<std::size_t>(face.first + k)].vertex);
              list.append(corners);
            }
            return list;
          },
          "numbers of the vertices of each face, counter-clockwise from outside")
      .def_property_readonly(
          "volume", [](const engine::Hull& hull) { return hull.surface->volume(); }, "[m^3]")
      .def_property_readonly(
          "centre", [](const engine::Hull& hull) { return tuple_of(hull.surface->centre()); },
          "centre of the volume [m]")
      .def("__repr__", [](const engine::Hull& hull) {
        return "Hull(" + std::to_string(hull.surface->vertices().size()) + " vertices)";
      });
  define_compound(module);
  for (const char* name :
       {"Point", "Sphere", "Box", "Plane", "Cylinder", "Hull", "Capsule", "Compound"})
    make_by_call_alone(py::object(module->attr(name)));
}

}  // namespace constraint_sim::python
