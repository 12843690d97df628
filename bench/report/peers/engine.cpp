// The engine of this package: every method by name, with every order.

#include <algorithm>
#include <limits>

#include "../contestant.h"
#include "constraint_sim/engine/scene.h"
#include "constraint_sim/engine/world.h"

namespace constraint_sim::report {
namespace {

using engine::BodyId;
using engine::Method;
using engine::World;

engine::Shape shape_of(const Body& body) {
  switch (body.shape) {
    case Shape::kSphere:
      return engine::Sphere{body.size.x()};
    case Shape::kBox:
      return engine::Box{body.size};
    case Shape::kPlane:
      return engine::Plane{};
    case Shape::kPoint:
      break;
  }
  return engine::Point{};
}

BodyId add(const Body& body, std::size_t number, World* world) {
  engine::Body added;
  added.name = "body_" + std::to_string(number);
  added.type = body.is_static ? engine::BodyType::kStatic : engine::BodyType::kDynamic;
  added.shape = shape_of(body);
  added.mass = body.mass;
  added.inertia = body.inertia;
  added.state = {body.start.position, body.start.orientation, body.start.velocity,
                 body.start.angular_velocity};
  added.friction = body.friction;
  added.restitution = body.restitution;
  const BodyId id = world->add_body(added);
  if (!body.force.isZero(0.0)) {
    engine::Wrench push;
    push.body = id;
    push.force = body.force;
    world->add_wrench(push);
  }
  return id;
}

engine::JointId add(const Joint& joint, const Coupling* screw, const std::vector<BodyId>& ids,
                    World* world) {
  const auto id = [&](int i) {
    return i == kWorld ? engine::kWorldBody : ids[static_cast<std::size_t>(i)];
  };
  engine::Joint added;
  added.name = "joint_" + std::to_string(world->joint_ids().size());
  added.body_a = id(joint.a);
  added.anchor_a = joint.anchor_a;
  added.body_b = id(joint.b);
  added.anchor_b = joint.anchor_b;
  if (joint.kind == JointKind::kBall) {
    added.kind = engine::JointKind::kBall;
  } else if (has_axes(joint.kind)) {
    added.kind =
        screw != nullptr ? engine::JointKind::kScrew : *engine::joint_kind_named(name(joint.kind));
    if (screw != nullptr) added.pitch = screw->pitch();
    added.frame_a = joint.frame_a;
    added.frame_b = joint.frame_b;
  } else if (joint.is_rope() && joint.restitution == 0.0 && joint.friction == 0.0) {
    added.distance.max_length = joint.upper;
  } else if (joint.kind == JointKind::kFreeLength) {
    added.kind = engine::JointKind::kFreeDistance;
  } else {
    engine::DistanceJoint distance;
    if (!(joint.length < 0.0)) distance.length = joint.length;  // NaN is passed on
    if (joint.kind == JointKind::kSpring) distance.stiffness = joint.stiffness;
    added.distance = distance;
  }
  if (added.kind == engine::JointKind::kDistance) {
    added.motor.bias = joint.rate;
    added.motor.max_force = joint.max_force;
    added.break_force = joint.break_force;
  } else if (joint.has_law()) {
    engine::CoordinateLaw& law = added.coordinates[0];
    law.lower = joint.lower;
    law.upper = joint.upper;
    law.limit_restitution = joint.restitution;
    law.friction = joint.friction;
    if (joint.max_force > 0.0) {
      law.motor.emplace();
      law.motor->bias = joint.rate;
      law.motor->max_force = joint.max_force;
    }
  }
  return world->add_joint(added);
}

void add(const Coupling& coupling, const std::vector<engine::JointId>& ids, World* world) {
  if (coupling.is_screw()) return;
  engine::Joint added;
  added.name = "coupling_" + std::to_string(world->joint_ids().size());
  added.coupling.first = ids[static_cast<std::size_t>(coupling.first)];
  added.coupling.second = ids[static_cast<std::size_t>(coupling.second)];
  added.coupling.ratio = coupling.ratio;
  const bool is_pulley = engine::info(world->joint(added.coupling.first).kind).is_free_length;
  added.kind = is_pulley ? engine::JointKind::kPulley : engine::JointKind::kGear;
  world->add_joint(added);
}

class EngineSimulation : public Simulation {
 public:
  EngineSimulation(const Problem& problem, const engine::WorldOptions& options, bool is_heard)
      : world_(options), is_heard_(is_heard) {
    for (std::size_t i = 0; i < problem.bodies.size(); ++i)
      ids_.push_back(add(problem.bodies[i], i, &world_));
    std::vector<engine::JointId> joints;
    for (std::size_t j = 0; j < problem.joints.size(); ++j)
      joints.push_back(add(problem.joints[j], problem.screw_of(j), ids_, &world_));
    for (const Coupling& coupling : problem.couplings) add(coupling, joints, &world_);
  }

  void advance(long ticks, double) override {
    for (long i = 0; i < ticks; ++i) {
      const engine::StepReport& report = world_.step();
      if (report.outcome.failed)
        throw Refused(std::string("the engine says that the step failed: ") +
                      engine::to_string(report.outcome.failure));
      if (is_heard_) hear(report);
    }
  }

  Said said() const override { return said_; }

  std::string scene() const override { return engine::save_scene(world_); }

  void read(States* states) const override {
    states->clear();
    for (const BodyId id : ids_) {
      const engine::BodyState& state = world_.state(id);
      states->push_back(
          {state.position, state.orientation, state.linear_velocity, state.angular_velocity});
    }
  }

 private:
  /// Keeps warnings but notices. Bodies that are too fast for the step are a notice, and
  /// inaccurate.
  void hear(const engine::StepReport& report) {
    said_.joint = std::max({said_.joint, report.joints.max_error, report.joints.closing_error});
    said_.penetration = std::max(said_.penetration, report.contacts.max_penetration);
    said_.motion += report.local_error;
    if (!said_.warning.empty()) return;
    for (const engine::StepWarning& warning : world_.warnings())
      if (!engine::info(warning.kind).is_notice ||
          warning.kind == engine::StepWarning::Kind::kUnresolved)
        said_.warning = engine::to_string(warning);
    for (const engine::Island& island : world_.islands())
      if (said_.warning.empty() && (island.why == engine::MethodReason::kInconsistent ||
                                    island.why == engine::MethodReason::kRefused))
        said_.warning = engine::to_string(island.why);
  }

  World world_;
  std::vector<BodyId> ids_;
  bool is_heard_;
  Said said_;
};

/// Returns the number at the end of a variant's name; 0 where there is none.
int number_after(const std::string& name, const std::string& start) {
  return name.rfind(start, 0) == 0 ? std::stoi(name.substr(start.size())) : 0;
}

}  // namespace

std::string Contestant::name() { return "constraint_sim"; }
std::string Contestant::version() { return CONSTRAINT_SIM_COMMIT; }

std::vector<Variant> Contestant::variants() {
  std::vector<Variant> variants;
  for (std::size_t i = 0; i < engine::kMethodCount; ++i) {
    const auto method = static_cast<Method>(i);
    const std::string name = engine::name(method);
    Variant variant{name};
    if (method == Method::kAuto || method == Method::kEventDriven) {
      variant.knob = Knob::kTolerance;
      for (double tolerance = 1e-1; tolerance > 3e-14; tolerance *= 0.1)
        variant.values.push_back(tolerance);
      variants.push_back(variant);
    } else if (method == Method::kRungeKutta) {
      for (const char* order : {"_order_8", "_order_5"}) variants.push_back({name + order});
    } else if (method == Method::kSequentialImpulses) {
      for (const char* sweeps : {"_10", "_50", "_200"}) variants.push_back({name + sweeps});
    } else if (method == Method::kEnergyMomentum) {
      variants.push_back(variant);
    }
  }
  return variants;
}

std::unique_ptr<Simulation> Contestant::make(const Problem& problem, const Variant& variant,
                                             const Setting& setting) {
  engine::WorldOptions options;
  options.gravity = problem.gravity;
  options.time_step = setting.tick;
  options.sleep_after = std::numeric_limits<double>::infinity();  // peers do not sleep either
  if (variant.knob == Knob::kTolerance && setting.is_swept) {
    options.tolerance = setting.tolerance;
  }
  for (std::size_t i = 0; i < engine::kMethodCount; ++i)
    if (variant.name.rfind(engine::name(static_cast<Method>(i)), 0) == 0)
      options.method = static_cast<Method>(i);
  if (variant.knob == Knob::kTick && setting.is_swept) options.tolerance = 0.0;
  if (options.method == Method::kRungeKutta) {
    options.order = number_after(variant.name, "runge_kutta_order_");
  } else if (options.method == Method::kSequentialImpulses) {
    options.iterations = number_after(variant.name, "sequential_impulses_");
  }
  if (!setting.is_swept && setting.tolerance > 0.0) options.tolerance = setting.tolerance;
  return std::make_unique<EngineSimulation>(problem, options, setting.is_heard);
}

}  // namespace constraint_sim::report
