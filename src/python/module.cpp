// The Python module constraint_sim.engine. Its stubs, with all types:
// python/constraint_sim/engine.pyi.

#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <fstream>
#include <memory>

#include "constraint_sim/plan.h"
#include "constraint_sim/scene.h"
#include "python/parameters.h"
#include "python/shared_world.h"

namespace constraint_sim::python {
namespace {

// ---- shapes

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
}

// ---- reports

py::dict islands_of(const engine::StepReport& report) {
  py::dict dict;
  for (std::size_t i = 0; i < engine::kMethodCount; ++i)
    if (static_cast<engine::Method>(i) != engine::Method::kAuto)
      dict[engine::name(static_cast<engine::Method>(i))] = report.islands[i];
  return dict;
}

void define_step_report(py::module* module) {
  using Report = engine::StepReport;
  py::class_<Report>(*module, "StepReport",
                     "What one step did, how wrong it is and what it cost. A copy: it keeps its "
                     "values when the world steps on.")
      .def_readonly("step", &Report::step, "steps since the start, this one included")
      .def_readonly("time", &Report::time, "simulated time after the step [s]")
      .def_readonly("max_constraint_error", &Report::max_constraint_error,
                    "largest |error| of the joints, springs excepted [m]")
      .def_readonly("max_penetration", &Report::max_penetration, "deepest contact [m]")
      .def_readonly("energy", &Report::energy,
                    "kinetic energy + potential energy of gravity and springs [J]")
      .def_readonly("energy_drift", &Report::energy_drift,
                    "change of energy since the last edit over the largest kinetic energy [1]")
      .def_readonly("local_error", &Report::local_error,
                    "largest error estimate of an island for this step [m]")
      .def_readonly("dependent_rows", &Report::dependent_rows,
                    "redundant equations, at most at once")
      .def_readonly("unresolved_bodies", &Report::unresolved_bodies,
                    "bodies of stiff islands that move faster than the step resolves")
      .def_readonly("torn_joints", &Report::torn_joints, "joints that broke in this step")
      .def_readonly("projected_energy", &Report::projected_energy,
                    "kinetic energy lost where velocities were projected onto the joints [J]")
      .def_readonly("failed", &Report::failed,
                    "the result was not finite; the world kept the state before the step")
      .def_property_readonly("islands", &islands_of, "islands advanced by each method")
      .def_readonly("asleep", &Report::asleep, "islands at rest, left out")
      .def_readonly("changes", &Report::changes, "changes of method")
      .def_readonly("substeps", &Report::substeps, "of all islands")
      .def_readonly("rejected", &Report::rejected, "rejected substeps")
      .def_readonly("iterations", &Report::iterations, "sweeps over the rows, and Newton's")
      .def_readonly("rows", &Report::rows, "scalar equations solved")
      .def_readonly("contacts", &Report::contacts, "contact points of islands that are awake")
      .def_readonly("candidate_pairs", &Report::candidate_pairs, "pairs after the broadphase")
      .def("__repr__", [](const Report& report) {
        return py::str("<StepReport step {} time {} s: constraint error {:.3g} m, failed {}>")
            .format(report.step, report.time, report.max_constraint_error, report.failed);
      });
}

void define_run_report(py::module* module) {
  py::class_<RunReport>(*module, "RunReport",
                        "Outcome of World.run: worst values over its steps, sums, and samples.")
      .def_readonly("steps", &RunReport::steps, "steps taken")
      .def_readonly("failed", &RunReport::failed,
                    "a step was not finite: the run ended with the state before it")
      .def_readonly("timed_out", &RunReport::timed_out, "time_limit was reached before the end")
      .def_readonly("wall_time", &RunReport::wall_time, "run time of the steps alone [s]")
      .def_readonly("max_constraint_error", &RunReport::max_constraint_error, "over all steps [m]")
      .def_readonly("max_penetration", &RunReport::max_penetration, "over all steps [m]")
      .def_readonly("accumulated_local_error", &RunReport::accumulated_local_error,
                    "sum of the steps' estimates [m]")
      .def_readonly("energy_initial", &RunReport::energy_initial, "before the first step [J]")
      .def_readonly("energy_final", &RunReport::energy_final, "after the last step [J]")
      .def_readonly("energy_drift", &RunReport::energy_drift, "of the last step [1]")
      .def_readonly("methods", &RunReport::methods, "that advanced an island")
      .def_readonly("unresolved_bodies", &RunReport::unresolved_bodies,
                    "names of bodies that moved faster than a step resolves")
      .def_readonly("substeps", &RunReport::substeps, "sum over all steps")
      .def_readonly("rejected", &RunReport::rejected, "rejected substeps, sum over all steps")
      .def_readonly("iterations", &RunReport::iterations, "sum over all steps")
      .def_readonly("rows", &RunReport::rows, "sum over all steps")
      .def_readonly("contacts", &RunReport::contacts, "sum over all steps")
      .def_readonly("torn_joints", &RunReport::torn_joints, "joints that broke")
      .def_readonly("changes", &RunReport::changes, "changes of method")
      .def_readonly("dependent_rows", &RunReport::dependent_rows, "most at once")
      .def_readonly("times", &RunReport::times, "of the samples [s], shape (samples,); or None")
      .def_readonly("states", &RunReport::states,
                    "samples of all bodies, shape (samples, bodies, 13) as World.states; or None")
      .def("__repr__", [](const RunReport& report) {
        return py::str("<RunReport {} steps: constraint error {:.3g} m, failed {}>")
            .format(report.steps, report.max_constraint_error, report.failed);
      });
}

py::dict island_dict(const engine::World& world, const engine::Island& island) {
  py::dict dict;
  dict["first_body"] = body_name(world, island.first_body);
  dict["bodies"] = island.bodies;
  dict["joints"] = island.joints;
  dict["method"] = engine::name(island.method);
  dict["why"] = engine::text(island.why);
  dict["local_error"] = island.local_error;
  dict["substeps"] = island.substeps;
  dict["rejected"] = island.rejected;
  dict["iterations"] = island.iterations;
  dict["unresolved_bodies"] = island.unresolved_bodies;
  dict["dependent_rows"] = island.dependent_rows;
  return dict;
}

py::dict contact_dict(const engine::World& world, const engine::Contact& contact) {
  py::dict dict;
  dict["body_a"] = body_name(world, contact.body_a);
  dict["body_b"] = body_name(world, contact.body_b);
  dict["position"] = tuple_of(contact.position);
  dict["normal"] = tuple_of(contact.normal);
  dict["depth"] = contact.depth;
  dict["normal_force"] = contact.normal_force;
  return dict;
}

py::dict joint_state_dict(const engine::JointState& state) {
  py::dict dict;
  dict["error"] = state.error;
  dict["error_rate"] = state.error_rate;
  dict["force"] = state.force;
  dict["bias"] = state.bias;
  dict["reached_rate"] = state.reached_rate;
  dict["travel"] = state.travel;
  dict["saturated"] = state.saturated;
  dict["broken"] = state.broken;
  dict["closing"] = state.closing;
  return dict;
}

// ---- the world

using Class = py::class_<SharedWorld>;

void define_bodies(Class* world) {
  world->def(
      "add_body",
      [](SharedWorld& self, const std::string& name, const py::kwargs& keywords) {
        engine::Body body;
        keywords["name"] = name;
        body_from(keywords, &body);
        self.edit([&](engine::World& edited) { edited.add_body(body); });
      },
      py::arg("name"),
      "add_body(name, *, type='dynamic', shape=Point(), mass [kg], inertia=(0, 0, 0) [kg m^2] "
      "principal, zero: from the shape, position [m], orientation x y z w, linear_velocity [m/s], "
      "angular_velocity [rad/s] in world axes, friction=0, restitution=0, no_collision=False)\n\n"
      "Adds a body. Raises ValueError naming field and value.");
  world->def(
      "remove_body",
      [](SharedWorld& self, const std::string& name) {
        return self.edit(
            [&](engine::World& edited) { return edited.remove_body(edited.find_body(name)); });
      },
      py::arg("name"), "Removes a body and its joints; returns the names of those joints.");
  world->def(
      "body",
      [](const SharedWorld& self, const std::string& name) {
        return body_dict(self.read().body(self.read().find_body(name)));
      },
      py::arg("name"), "The body as it was added: the keywords of add_body.");
  world->def(
      "state",
      [](const SharedWorld& self, const std::string& name) {
        return state_dict(self.read().state(self.read().find_body(name)));
      },
      py::arg("name"),
      "State now: position [m], orientation x y z w, linear_velocity [m/s], "
      "angular_velocity [rad/s], world axes.");
  world->def(
      "set_state",
      [](SharedWorld& self, const std::string& name, const py::kwargs& keywords) {
        self.edit([&](engine::World& edited) {
          const engine::BodyId id = edited.find_body(name);
          engine::BodyState state = edited.state(id);
          state_from(keywords, &state);
          edited.set_state(id, state);
        });
      },
      py::arg("name"),
      "set_state(name, *, position [m], orientation x y z w, linear_velocity [m/s], "
      "angular_velocity [rad/s])\n\nSets what is named and keeps the rest.");
  world->def_property_readonly(
      "body_names",
      [](const SharedWorld& self) {
        py::list names;
        for (const engine::BodyId id : self.read().body_ids())
          names.append(self.read().body(id).name);
        return names;
      },
      "In the order of adding, which is that of the rows of the arrays.");
  world->def(
      "index",
      [](const SharedWorld& self, const std::string& name) {
        const engine::BodyId wanted = self.read().find_body(name);
        const std::vector<engine::BodyId> ids = self.read().body_ids();
        return std::find(ids.begin(), ids.end(), wanted) - ids.begin();
      },
      py::arg("name"), "Row of a body in the arrays.");
}

void define_arrays(Class* world) {
  const char* lifetime =
      "\n\nA read-only view, no copy: it follows the world until a body is added or removed, then "
      "keeps the last state. Its memory outlives the world.";
  const auto define = [&](const char* name, py::ssize_t first, py::ssize_t count,
                          const std::string& meaning) {
    const std::string doc = meaning + lifetime;
    world->def_property_readonly(
        name, [=](SharedWorld& self) { return self.columns(first, count); }, doc.c_str());
  };
  define("states", 0, kStateSize,
         "Positions, orientations, linear and angular velocities, shape (bodies, 13).");
  define("positions", 0, 3, "Centres of mass, world [m], shape (bodies, 3).");
  define("orientations", 3, 4, "Body to world, x y z w, shape (bodies, 4).");
  define("linear_velocities", 7, 3, "Of the centres of mass, world [m/s], shape (bodies, 3).");
  define("angular_velocities", 10, 3, "World axes [rad/s], shape (bodies, 3).");
}

void define_joints(Class* world) {
  world->def(
      "add_joint",
      [](SharedWorld& self, const std::string& name, const py::kwargs& keywords) {
        keywords["name"] = name;
        bool is_broken = false;
        const engine::Joint joint = joint_from(keywords, self.read(), &is_broken);
        self.edit([&](engine::World& edited) { edited.add_joint(joint, is_broken); });
      },
      py::arg("name"),
      "add_joint(name, *, type='distance' or 'ball', body_a='world', anchor_a=(0, 0, 0) [m] in "
      "the body's frame, body_b='world', anchor_b, length=None [m] None: the present distance, "
      "min_length=0, max_length=inf [m], frequency [Hz] and damping_ratio, or stiffness [N/m] and "
      "damping [N s/m], baumgarte=None, break_force=0 [N], collide_connected=False, broken=False, "
      "motor={})\n\nAdds a joint; the motor's keywords are those of set_motor.");
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
        return joint_dict(read.joint(id), read, read.joint_state(id).broken);
      },
      py::arg("name"),
      "The joint with its length and stiffness filled in: the keywords of "
      "add_joint.");
  world->def(
      "joint_state",
      [](const SharedWorld& self, const std::string& name) {
        return joint_state_dict(self.read().joint_state(self.read().find_joint(name)));
      },
      py::arg("name"),
      "State after the last step: error [m], error_rate [m/s], force [N] along the joint, < 0 is "
      "tension, bias and reached_rate [m/s], travel of the motor [m], saturated, broken, closing.");
  world->def_property_readonly(
      "joint_names",
      [](const SharedWorld& self) {
        py::list names;
        for (const engine::JointId id : self.read().joint_ids())
          names.append(self.read().joint(id).name);
        return names;
      },
      "In the order of adding.");
  world->def(
      "set_motor",
      [](SharedWorld& self, const std::string& name, const py::kwargs& keywords) {
        self.edit([&](engine::World& edited) {
          engine::Motor motor;
          motor_from(keywords, &motor);
          edited.set_motor(edited.find_joint(name), motor);
        });
      },
      py::arg("name"),
      "set_motor(name, *, bias=0 [m/s] > 0 lengthens, amplitude=0 [m/s], frequency=0 [Hz], "
      "phase=0 [rad], max_force=0 [N] 0: no limit, timeout=0 [s] 0: never)\n\nReplaces the motor; "
      "its timeout counts from now.");
  world->def(
      "set_broken",
      [](SharedWorld& self, const std::string& name, bool is_broken) {
        self.edit(
            [&](engine::World& edited) { edited.set_broken(edited.find_joint(name), is_broken); });
      },
      py::arg("name"), py::arg("broken"), "Marks a joint as broken, or whole again.");
}

void define_wrenches(Class* world) {
  world->def(
      "add_wrench",
      [](SharedWorld& self, const std::string& name, const py::kwargs& keywords) {
        self.edit([&](engine::World& edited) {
          engine::Wrench wrench;
          wrench.body = edited.find_body(name);
          wrench.start = edited.time();
          double duration = std::numeric_limits<double>::infinity();
          Keywords reading("add_wrench", keywords);
          reading.read("force", &wrench.force);
          reading.read("torque", &wrench.torque);
          reading.read("start", &wrench.start);
          reading.read("duration", &duration);
          reading.expect_no_more();
          wrench.end = wrench.start + duration;
          edited.add_wrench(wrench);
        });
      },
      py::arg("body"),
      "add_wrench(body, *, force=(0, 0, 0) [N], torque=(0, 0, 0) [N m], start=now [s], "
      "duration=inf [s])\n\nForce at the centre of mass and torque, world axes, for an interval of "
      "simulated time. Several add up.");
  world->def(
      "clear_wrenches",
      [](SharedWorld& self, const std::string& name) {
        self.edit([&](engine::World& edited) { edited.clear_wrenches(edited.find_body(name)); });
      },
      py::arg("body"), "Removes all wrenches of a body.");
}

void define_motion(Class* world) {
  world->def("step", &SharedWorld::step, py::return_value_policy::copy,
             "Advances the world by one tick, without the GIL; returns its StepReport.");
  world->def(
      "run",
      [](SharedWorld& self, const py::object& duration, const py::kwargs& keywords) {
        int every = 0;
        double time_limit = std::numeric_limits<double>::infinity();
        Keywords reading("run", keywords);
        reading.read("every", &every);
        reading.read("time_limit", &time_limit);
        reading.expect_no_more();
        if (every < 0)
          throw std::invalid_argument("every: must be a whole number >= 0, got " +
                                      std::to_string(every));
        return self.run(number("duration", duration), static_cast<std::uint64_t>(every),
                        time_limit);
      },
      py::arg("duration"),
      "run(duration [s], *, every=0, time_limit=inf [s])\n\nAdvances the world by so much "
      "simulated time, to the nearest tick, without the GIL; ends early when a step fails or the "
      "run time exceeds time_limit. With `every` the RunReport has samples: the start and every so "
      "many ticks.");
  world->def_property_readonly(
      "report", [](const SharedWorld& self) { return engine::StepReport(self.read().report()); },
      "StepReport of the last step.");
  world->def_property_readonly(
      "time", [](const SharedWorld& self) { return self.read().time(); }, "Simulated time [s].");
  world->def_property_readonly(
      "step_count", [](const SharedWorld& self) { return self.read().step_count(); },
      "Steps since the start.");
  world->def_property_readonly(
      "energy", [](const SharedWorld& self) { return self.read().energy(); },
      "Kinetic energy + potential energy of gravity and springs, now [J].");
  world->def_property_readonly(
      "state_hash", [](const SharedWorld& self) { return self.read().state_hash(); },
      "64-bit hash of time, bodies, joints, wrenches and their state, as constraint_sim_run "
      "prints it.");
  world->def(
      "reset", [](SharedWorld& self) { self.edit([](engine::World& edited) { edited.reset(); }); },
      "Returns bodies and joints to what they were when added; time goes on.");
  world->def(
      "set_time",
      [](SharedWorld& self, const py::object& time, std::uint64_t step_count) {
        const double seconds = number("time", time);
        self.edit([&](engine::World& edited) { edited.set_time(seconds, step_count); });
      },
      py::arg("time"), py::arg("step_count"), "Continues from this simulated time [s] and step.");
}

void define_reports(Class* world) {
  world->def(
      "islands",
      [](const SharedWorld& self) {
        py::list list;
        for (const engine::Island& island : self.read().islands())
          list.append(island_dict(self.read(), island));
        return list;
      },
      "Islands with method, reason and cost, as of the last step; before the first as it begins.");
  world->def(
      "contacts",
      [](const SharedWorld& self) {
        py::list list;
        for (const engine::Contact& contact : self.read().contacts())
          list.append(contact_dict(self.read(), contact));
        return list;
      },
      "Contact points of the last step: bodies, position [m], normal from B to A, depth [m], "
      "normal_force [N].");
  world->def(
      "unresolved_bodies",
      [](const SharedWorld& self) {
        py::list names;
        for (const engine::BodyId id : self.read().unresolved_bodies())
          names.append(self.read().body(id).name);
        return names;
      },
      "Names of bodies of stiff islands that the last step was too long to resolve.");
  world->def(
      "explain", [](const SharedWorld& self) { return engine::explain(self.read()); },
      "Plan: what the world uses, what it leaves out and why, as YAML.");
  world->def(
      "left_out", [](const SharedWorld& self) { return engine::left_out(self.read()); },
      "What the world leaves out and why, one line each.");
  world->def(
      "save_scene", [](const SharedWorld& self) { return engine::save_scene(self.read()); },
      "The world as it is now, as text of a scene; every number to 4 ulp.");
  world->def(
      "save_scene_file",
      [](const SharedWorld& self, const std::string& path) {
        std::ofstream file(path);
        file << engine::save_scene(self.read());
        file.close();
        if (!file) throw std::invalid_argument("path: cannot write '" + path + "'");
      },
      py::arg("path"), "The same into a file.");
}

void define_world(py::module* module) {
  Class world(*module, "World",
              "World(**options)\n\nBodies, joints and their motion. Options as in docs/scenes.md: "
              "gravity [m/s^2], time_step [s], method, tolerance [m/s], order, ... Bad input "
              "raises ValueError naming field and value and changes nothing. Different worlds may "
              "be stepped on different threads; one world by one thread at a time.");
  world.def(py::init([](const py::kwargs& keywords) {
    engine::WorldOptions options;
    options_from(keywords, &options);
    return std::make_unique<SharedWorld>(engine::World(options));
  }));
  world.def_property_readonly(
      "options", [](const SharedWorld& self) { return options_dict(self.read().options()); },
      "All options, as a dict.");
  world.def(
      "set_options",
      [](SharedWorld& self, const py::kwargs& keywords) {
        self.edit([&](engine::World& edited) {
          engine::WorldOptions options = edited.options();
          options_from(keywords, &options);
          edited.set_options(options);
        });
      },
      "set_options(**options)\n\nSets the options that are named and keeps the others.");
  const auto copy = [](const SharedWorld& self) {
    return std::make_unique<SharedWorld>(engine::World(self.read()));
  };
  world.def("copy", copy, "A snapshot: an independent world that goes on with the same bits.");
  world.def("__copy__", copy);
  world.def("__deepcopy__",
            [copy](const SharedWorld& self, const py::dict&) { return copy(self); });
  world.def(
      "restore",
      [](SharedWorld& self, const SharedWorld& snapshot) {
        const engine::World& saved = snapshot.read();
        self.edit([&](engine::World& edited) {
          if (&edited != &saved) edited = saved;
        });
      },
      py::arg("snapshot"), "Becomes a copy of a snapshot; arrays follow.");
  world.def("__repr__", [](const SharedWorld& self) {
    return py::str("<World at {} s: {} bodies, {} joints>")
        .format(self.read().time(), self.read().body_ids().size(), self.read().joint_ids().size());
  });
  define_bodies(&world);
  define_arrays(&world);
  define_joints(&world);
  define_wrenches(&world);
  define_motion(&world);
  define_reports(&world);
}

engine::WorldOptions defaults_from(const py::kwargs& keywords) {
  engine::WorldOptions defaults;
  options_from(keywords, &defaults);
  return defaults;
}

void define_scenes(py::module* module) {
  module->def(
      "load_scene",
      [](const std::string& text, const std::string& source, const py::kwargs& defaults) {
        return std::make_unique<SharedWorld>(
            engine::load_scene(text, source, defaults_from(defaults)));
      },
      py::arg("text"), py::arg("source") = "scene",
      "load_scene(text, source='scene', **defaults)\n\nWorld of a scene in YAML (docs/scenes.md). "
      "`source` names it in errors; `defaults` are options that hold where the scene sets none. "
      "Raises SceneError, a ValueError, with line, key and value.");
  module->def(
      "load_scene_file",
      [](const std::string& path, const py::kwargs& defaults) {
        return std::make_unique<SharedWorld>(
            engine::load_scene_file(path, defaults_from(defaults)));
      },
      py::arg("path"), "load_scene_file(path, **defaults)\n\nThe same from a file.");
}

}  // namespace
}  // namespace constraint_sim::python

PYBIND11_MODULE(engine, module) {
  namespace py = pybind11;
  using namespace constraint_sim::python;
  py::options options;
  options.disable_function_signatures();  // the docstrings have them, with units
  module.doc() =
      "The engine of constraint_sim: worlds of rigid bodies, stepped without ROS.\n\n"
      "All quantities are in SI units, vectors in world axes, quaternions as x y z w. "
      "docs/python.md is the manual.";
  module.attr("__version__") = CONSTRAINT_SIM_VERSION;
  py::list methods;
  for (std::size_t i = 0; i < constraint_sim::engine::kMethodCount; ++i)
    methods.append(constraint_sim::engine::name(static_cast<constraint_sim::engine::Method>(i)));
  module.attr("METHODS") = py::tuple(methods);
  py::register_exception<constraint_sim::engine::SceneError>(module, "SceneError",
                                                             PyExc_ValueError);
  define_shapes(&module);
  define_step_report(&module);
  define_run_report(&module);
  define_world(&module);
  define_scenes(&module);
}
