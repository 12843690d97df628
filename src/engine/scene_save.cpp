#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cmath>

#include "constraint_sim/scene.h"
#include "engine/validate.h"

namespace constraint_sim::engine {
namespace {

void write(YAML::Emitter* out, const char* key, const std::string& value) {
  *out << YAML::Key << key << YAML::Value << value;
}

void write(YAML::Emitter* out, const char* key, const char* value) {
  write(out, key, std::string(value));
}

void write(YAML::Emitter* out, const char* key, double value) {
  write(out, key, std::isinf(value) ? ".inf" : shortest(value));
}

void write(YAML::Emitter* out, const char* key, bool value) {
  *out << YAML::Key << key << YAML::Value << value;
}

void write(YAML::Emitter* out, const char* key, const Eigen::Ref<const Eigen::VectorXd>& values) {
  *out << YAML::Key << key << YAML::Value << YAML::Flow << YAML::BeginSeq;
  for (Eigen::Index i = 0; i < values.size(); ++i) *out << shortest(values[i]);
  *out << YAML::EndSeq;
}

void write_options(YAML::Emitter* out, const WorldOptions& options) {
  *out << YAML::Key << "world" << YAML::Value << YAML::BeginMap;
  write(out, "gravity", options.gravity);
  write(out, "time_step", options.time_step);
  write(out, "method", name(options.method));
  *out << YAML::Key << "order" << YAML::Value << options.order;
  write(out, "tolerance", options.tolerance);
  *out << YAML::Key << "stiff_order" << YAML::Value << options.stiff_order;
  write(out, "dissipation", options.dissipation);
  write(out, "stiffness_limit", options.stiffness_limit);
  *out << YAML::Key << "iterations" << YAML::Value << options.iterations;
  write(out, "warm_starting", options.warm_starting);
  write(out, "baumgarte", options.baumgarte);
  write(out, "closing_time", options.closing_time);
  write(out, "sleep_after", options.sleep_after);
  write(out, "sleep_speed", options.sleep_speed);
  *out << YAML::Key << "threads" << YAML::Value << options.threads;
  *out << YAML::EndMap;
}

// ---- bodies

const char* type_name(BodyType type) {
  switch (type) {
    case BodyType::kDynamic:
      return "dynamic";
    case BodyType::kStatic:
      return "static";
    case BodyType::kKinematic:
      break;
  }
  return "kinematic";
}

struct ShapeWriter {
  YAML::Emitter* out;

  void operator()(const Point&) const { begin("point"); }
  void operator()(const Sphere& sphere) const {
    begin("sphere");
    write(out, "radius", sphere.radius);
  }
  void operator()(const Box& box) const {
    begin("box");
    write(out, "size", box.size);
  }
  void operator()(const Plane&) const { begin("plane"); }

 private:
  void begin(const char* kind) const {
    *out << YAML::Key << kind << YAML::Value << YAML::Flow << YAML::BeginMap;
  }
};

void write_body(YAML::Emitter* out, const Body& body, const BodyState& state) {
  *out << YAML::BeginMap;
  write(out, "name", body.name);
  write(out, "type", type_name(body.type));
  *out << YAML::Key << "shape" << YAML::Value << YAML::Flow << YAML::BeginMap;
  std::visit(ShapeWriter{out}, body.shape);
  *out << YAML::EndMap << YAML::EndMap;
  write(out, "mass", body.mass);
  write(out, "inertia", body.inertia);
  write(out, "position", state.position);
  write(out, "orientation", state.orientation.coeffs());
  write(out, "linear_velocity", state.linear_velocity);
  write(out, "angular_velocity", state.angular_velocity);
  write(out, "friction", body.friction);
  write(out, "restitution", body.restitution);
  write(out, "no_collision", body.no_collision);
  *out << YAML::EndMap;
}

// ---- constraints

/// The motor that, started at time 0, goes on as this one does from `time` [s].
Motor from_now_on(Motor motor, const JointState& state, double time) {
  if (time != 0.0 && motor.frequency != 0.0) {
    const double turn = 2.0 * M_PI;
    motor.phase = std::fmod(motor.phase + turn * motor.frequency * time, turn);
    if (motor.phase < 0.0) motor.phase += turn;
  }
  if (std::isfinite(state.expires_at)) {
    motor.timeout = std::max(0.0, state.time_left(motor, time));
    if (motor.timeout == 0.0) motor.bias = 0.0;
  } else {
    motor.timeout = 0.0;
  }
  return motor;
}

/// Lengths with what the motor has added to them.
DistanceJoint with_travel(DistanceJoint distance, double travel) {
  if (distance.length) *distance.length = std::max(0.0, *distance.length + travel);
  if (distance.min_length > 0.0) distance.min_length = std::max(0.0, distance.min_length + travel);
  distance.max_length += travel;
  return distance;
}

void write_distance(YAML::Emitter* out, const DistanceJoint& distance) {
  const bool has_length = !distance.is_limited() || distance.is_soft();
  if (has_length && distance.length) write(out, "length", *distance.length);
  if (distance.min_length > 0.0) write(out, "min_length", distance.min_length);
  if (std::isfinite(distance.max_length)) write(out, "max_length", distance.max_length);
  if (!distance.is_soft()) return;
  write(out, "stiffness", distance.stiffness);
  write(out, "damping", distance.damping);
}

void write_motor(YAML::Emitter* out, const Motor& motor) {
  const bool is_default = motor.bias == 0.0 && motor.amplitude == 0.0 && motor.frequency == 0.0 &&
                          motor.phase == 0.0 && motor.max_force == 0.0 && motor.timeout == 0.0;
  if (is_default) return;
  *out << YAML::Key << "motor" << YAML::Value << YAML::Flow << YAML::BeginMap;
  write(out, "bias", motor.bias);
  write(out, "amplitude", motor.amplitude);
  write(out, "frequency", motor.frequency);
  write(out, "phase", motor.phase);
  write(out, "max_force", motor.max_force);
  write(out, "timeout", motor.timeout);
  *out << YAML::EndMap;
}

void write_joint(YAML::Emitter* out, const World& world, const Joint& joint,
                 const JointState& state) {
  const auto body_name = [&](BodyId id) {
    return id == kWorldBody ? std::string("world") : world.body(id).name;
  };
  *out << YAML::BeginMap;
  write(out, "name", joint.name);
  write(out, "type", type_name(joint.type));
  write(out, "body_a", body_name(joint.body_a));
  write(out, "anchor_a", joint.anchor_a);
  write(out, "body_b", body_name(joint.body_b));
  write(out, "anchor_b", joint.anchor_b);
  if (const auto* distance = std::get_if<DistanceJoint>(&joint.type))
    write_distance(out, with_travel(*distance, state.travel));
  write_motor(out, from_now_on(joint.motor, state, world.time()));
  if (joint.baumgarte) write(out, "baumgarte", *joint.baumgarte);
  write(out, "break_force", joint.break_force);
  write(out, "collide_connected", joint.collide_connected);
  if (state.broken) write(out, "broken", true);
  *out << YAML::EndMap;
}

void write_wrench(YAML::Emitter* out, const World& world, const Wrench& wrench) {
  const double start = std::max(0.0, wrench.start - world.time());
  const double end = wrench.end - world.time();
  *out << YAML::BeginMap;
  write(out, "body", world.body(wrench.body).name);
  write(out, "force", wrench.force);
  write(out, "torque", wrench.torque);
  write(out, "start", start);
  if (std::isfinite(end)) write(out, "duration", end - start);
  *out << YAML::EndMap;
}

}  // namespace

std::string save_scene(const World& world) {
  YAML::Emitter out;
  out << YAML::BeginMap;
  write_options(&out, world.options());
  out << YAML::Key << "bodies" << YAML::Value << YAML::BeginSeq;
  for (const BodyId id : world.body_ids()) write_body(&out, world.body(id), world.state(id));
  out << YAML::EndSeq;
  out << YAML::Key << "constraints" << YAML::Value << YAML::BeginSeq;
  for (const JointId id : world.joint_ids())
    write_joint(&out, world, world.joint(id), world.joint_state(id));
  out << YAML::EndSeq;
  if (!world.wrenches().empty()) {
    out << YAML::Key << "wrenches" << YAML::Value << YAML::BeginSeq;
    for (const Wrench& wrench : world.wrenches()) write_wrench(&out, world, wrench);
    out << YAML::EndSeq;
  }
  out << YAML::EndMap;
  return std::string(out.c_str()) + "\n";
}

}  // namespace constraint_sim::engine
