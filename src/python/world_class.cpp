#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "constraint_sim/engine/plan.h"
#include "constraint_sim/engine/scene.h"
#include "engine/support/files.h"
#include "python/definitions.h"
#include "python/keywords.h"
#include "python/parameters.h"

namespace constraint_sim::python {
namespace {

// Making a Python object may let another thread run, so data behind references into a world are
// copied first.

// ---- lists of dicts

py::dict island_dict(const engine::World& world, const engine::Island& island) {
  py::dict dict;
  dict["first_body"] = body_name(world, island.first_body);
  dict["bodies"] = island.bodies;
  dict["joints"] = island.joints;
  dict["method"] = engine::name(island.method);
  dict["why"] = engine::to_string(island.why);
  dict["local_error"] = known(island.local_error);
  dict["substeps"] = island.substeps;
  dict["rejected"] = island.rejected;
  dict["evaluations"] = island.evaluations;
  dict["iterations"] = island.iterations;
  dict["events"] = island.events;
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
  dict["force"] = tuple_of(contact.force);
  dict["state"] = engine::name(contact.state);
  dict["part_a"] = contact.part_a;
  dict["part_b"] = contact.part_b;
  return dict;
}

py::dict event_dict(const engine::World& world, const engine::Event& event) {
  py::dict dict;
  dict["kind"] = engine::name(event.kind);
  dict["time"] = event.time;
  dict["body_a"] = body_name(world, event.body_a);
  dict["body_b"] = body_name(world, event.body_b);
  dict["joint"] = event.joint ? py::cast(world.joint(*event.joint).name) : py::none();
  dict["coordinate"] = event.coordinate >= 0 ? py::cast(event.coordinate) : py::none();
  dict["impulse"] = event.impulse;
  return dict;
}

py::dict warning_dict(const engine::StepWarning& warning) {
  const engine::WarningInfo& info = engine::info(warning.kind);
  py::dict dict;
  dict["kind"] = info.name;
  dict["name"] = warning.name;
  dict["value"] = warning.value;
  dict["unit"] = info.unit;
  dict["advice"] = info.advice;
  dict["is_notice"] = info.is_notice;
  dict["text"] = engine::with_advice(warning);
  return dict;
}

// ---- the world

using Class = WorldClass;

void define_bodies(Class* world) {
  world->def(
      "add_body",
      [](SharedWorld& self, const std::string& name, const py::kwargs& keywords) {
        engine::Body body;
        keywords["name"] = name;
        body_from(frozen(keywords), &body);
        self.edit([&](engine::World& edited) { edited.add_body(body); });
      },
      py::arg("name"),
      "add_body(name, *, type='dynamic', shape=Point(), mass [kg], inertia=(0, 0, 0) [kg m^2] "
      "principal, zero: from the shape, position [m], orientation x y z w, linear_velocity [m/s], "
      "angular_velocity [rad/s] in world axes, friction=0, restitution=0, no_collision=False,\n"
      "collision_groups=1, collision_mask=0xffffffff: bits of the groups of the body, and of "
      "those\n"
      "with which it collides; gravity_compensation=0, share of the weight that nothing has to "
      "carry,\n"
      "shape_pose=None: a dict of position [m] and orientation (x, y, z, w) of a sphere, box,\n"
      "cylinder, capsule or hull in the body's frame; the shapes of a Compound have their own)\n\n"
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
        const engine::Body body = self.read().body(self.read().find_body(name));
        return body_dict(body);
      },
      py::arg("name"), "The body as it was added: the keywords of add_body.");
}

void define_states(Class* world) {
  world->def(
      "state",
      [](const SharedWorld& self, const std::string& name) {
        const engine::BodyState state = self.read().state(self.read().find_body(name));
        return state_dict(state);
      },
      py::arg("name"),
      "State now: position [m], orientation x y z w, linear_velocity [m/s], "
      "angular_velocity [rad/s], world axes.");
  world->def(
      "set_state",
      [](SharedWorld& self, const std::string& name, const py::kwargs& keywords) {
        const py::dict given = frozen(keywords);
        self.edit([&](engine::World& edited) {
          const engine::BodyId id = edited.find_body(name);
          engine::BodyState state = edited.state(id);
          state_from(given, &state);
          edited.set_state(id, state);
        });
      },
      py::arg("name"),
      "set_state(name, *, position [m], orientation x y z w, linear_velocity [m/s], "
      "angular_velocity [rad/s])\n\nSets the given parts and keeps the others.");
  world->def_property_readonly(
      "body_names",
      [](const SharedWorld& self) {
        py::list names;
        for (const engine::BodyId id : self.read().body_ids())
          names.append(self.read().body(id).name);
        return names;
      },
      "Names in the order of adding, which is the order of rows of the arrays.");
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
  define("orientations", 3, 4, "Orientations, body to world, x y z w, shape (bodies, 4).");
  define("linear_velocities", 7, 3,
         "Velocities of the centres of mass, world [m/s], shape (bodies, 3).");
  define("angular_velocities", 10, 3, "Angular velocities, world axes [rad/s], shape (bodies, 3).");
}

void define_wrenches(Class* world) {
  world->def(
      "add_wrench",
      [](SharedWorld& self, const std::string& name, const py::kwargs& keywords) {
        const py::dict given = frozen(keywords);
        self.edit([&](engine::World& edited) {
          engine::Wrench wrench;
          wrench.body = edited.find_body(name);
          wrench.start = edited.time();
          double duration = std::numeric_limits<double>::infinity();
          Keywords reading("add_wrench", given);
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
  world->def("step", &SharedWorld::step,
             "Advances the world by one tick, without the GIL; returns its StepReport.");
  world->def(
      "run",
      [](SharedWorld& self, const py::object& duration, const py::kwargs& keywords) {
        int every = 0;
        double time_limit = std::numeric_limits<double>::infinity();
        Keywords reading("run", frozen(keywords));
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
      "run(duration [s], *, every=0, time_limit=inf [s])\n\nAdvances the world by this "
      "simulated time, to the nearest tick, without the GIL; ends early when a step fails or the "
      "run time exceeds time_limit. With `every` the RunReport has samples: the start and each "
      "`every`-th tick.");
}

void define_time(Class* world) {
  world->def_property_readonly(
      "report", [](const SharedWorld& self) { return NamedReport(self.read()); },
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

void define_lists(Class* world) {
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
        const std::vector<engine::Contact> copies = self.read().contacts();
        for (const engine::Contact& contact : copies)
          list.append(contact_dict(self.read(), contact));
        return list;
      },
      "Contact points of the last step: bodies, position [m], normal from B to A, depth [m], "
      "normal_force [N], force of both normal and friction on A [N], state, and the number of the\n"
      "shape of each body that touches, part_a and part_b.");
  world->def(
      "events",
      [](const SharedWorld& self) {
        py::list list;
        const std::vector<engine::Event> copies = self.read().events();
        for (const engine::Event& event : copies) list.append(event_dict(self.read(), event));
        return list;
      },
      "Events of the last step, in the order of time: kind ('broken', 'rope_taut', "
      "'rope_slack', 'limit_reached', 'limit_left', 'saturated', 'released', 'slips', 'sticks', "
      "'contact_began', 'contact_ended', 'hit', 'handed_over', 'taken_back'), time [s], bodies, "
      "joint or None of a contact or an island, coordinate of the joint or None, impulse of an "
      "impact [N s or N m s].");
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
      "step_warnings",
      [](const SharedWorld& self) {
        py::list list;
        for (const engine::StepWarning& warning : self.read().warnings())
          list.append(warning_dict(warning));
        return list;
      },
      "Warnings of the last step, as dicts: kind ('unclosed', 'energy_rise', 'hits_left', "
      "'overlap', 'creep', 'unsolved', 'unresolved', 'handed_over'), name of the joint or body, "
      "value, unit ('' of a number), advice, is_notice where the result is still trustworthy, and "
      "text, one line with the advice. Empty between an edit and the next step.");
}

void define_texts(Class* world) {
  world->def(
      "explain", [](const SharedWorld& self) { return engine::explain(self.read()); },
      "Plan: what the world uses, what it leaves out and why, as YAML.");
  world->def(
      "left_out", [](const SharedWorld& self) { return engine::left_out(self.read()); },
      "Parts of the engine that the world leaves out and why, one line each.");
  world->def(
      "doubtful_settings",
      [](const SharedWorld& self) { return engine::doubtful_settings(self.read()); },
      "Settings that may be mistakes, one line each: inertias that no distribution of mass has.");
  world->def(
      "save_scene", [](const SharedWorld& self) { return engine::save_scene(self.read()); },
      "The world as it is now, as text of a scene; every number to 4 ulp.");
  world->def(
      "save_scene_file",
      [](const SharedWorld& self, const std::string& path) {
        engine::write_file(path, engine::save_scene(self.read()));
      },
      py::arg("path"), "Saves the scene that save_scene() returns into a file.");
}

void define_options(Class* world) {
  world->def_property_readonly(
      "options", [](const SharedWorld& self) { return options_dict(self.read().options()); },
      "All options, as a dict.");
  world->def(
      "set_options",
      [](SharedWorld& self, const py::kwargs& keywords) {
        const py::dict given = frozen(keywords);
        self.edit([&](engine::World& edited) {
          engine::WorldOptions options = edited.options();
          options_from(given, &options);
          edited.set_options(options);
        });
      },
      "set_options(**options)\n\nSets the options that are named and keeps the others.");
  world->def("__repr__", [](const SharedWorld& self) {
    return py::str("<World at {} s: {} bodies, {} joints>")
        .format(self.read().time(), self.read().body_ids().size(), self.read().joint_ids().size());
  });
}

void define_snapshots(Class* world) {
  const auto copy = [](const SharedWorld& self) {
    return std::make_unique<SharedWorld>(engine::World(self.read()));
  };
  world->def("copy", copy, "A snapshot: an independent world that goes on with the same bits.");
  world->def("__copy__", copy);
  world->def("__deepcopy__",
             [copy](const SharedWorld& self, const py::dict&) { return copy(self); });
  world->def(
      "restore",
      [](SharedWorld& self, const SharedWorld& snapshot) {
        const engine::World& saved = snapshot.read();
        self.edit([&](engine::World& edited) {
          if (&edited != &saved) edited = saved;
        });
      },
      py::arg("snapshot"), "Becomes a copy of a snapshot; arrays follow.");
}

}  // namespace

void define_world(py::module* module) {
  Class world(*module, "World",
              "World(**options)\n\nBodies, joints and their motion. Options as in docs/scenes.md: "
              "gravity [m/s^2], time_step [s], method, tolerance [m/s], order, ... Bad input "
              "raises ValueError naming field and value and changes nothing. Different worlds may "
              "be stepped on different threads; one world by one thread at a time.");
  world.def(py::init([](const py::kwargs& keywords) {
    engine::WorldOptions options;
    options_from(frozen(keywords), &options);
    return std::make_unique<SharedWorld>(engine::World(options));
  }));
  define_options(&world);
  define_snapshots(&world);
  define_bodies(&world);
  define_states(&world);
  define_arrays(&world);
  define_geometry(&world);
  define_joints(&world);
  define_robots(&world);
  define_robot_dynamics(module, &world);
  define_wrenches(&world);
  define_motion(&world);
  define_verify(&world);
  define_time(&world);
  define_lists(&world);
  define_texts(&world);
  make_by_call_alone(world);
}

}  // namespace constraint_sim::python
