#include "engine/model/validate.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <stdexcept>

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/joint.h"
#include "constraint_sim/engine/report.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/math/numbers.h"
#include "engine/model/fields.h"
#include "engine/model/option_values.h"
#include "engine/model/shape_properties.h"

namespace constraint_sim::engine {
namespace {

constexpr std::size_t kLongestName = 255;
constexpr double kLeastMagnitude = 1e-20;  // least magnitude of a divisor
// Rounding of the squared norm of a unit quaternion. Quaternions within it keep their bits, so that
// a saved scene is read as it was.
constexpr double kUnitRounding = 1e-15;
// Limits of moments of inertia [kg m²], from largest and least mass and distance.
constexpr double kMostInertia = 1e60, kLeastInertia = 1e-60;

bool is_name_start(char c) {
  return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_';
}

// Texts of numbers are made for rejections alone: they take a hundred times as long as a check.
[[noreturn]] void refuse_beyond(const std::string& field, double most, const std::string& got) {
  refuse(field, "must be at most " + shortest(most) + ", got " + got);
}

bool is_name_character(char c) { return is_name_start(c) || c == '.' || c == '/' || c == '-'; }

}  // namespace

void refuse(const std::string& field, const std::string& why) {
  throw std::invalid_argument(field + ": " + why);
}

std::string shortest(double value) {
  char text[32];
  for (int digits = 15; digits <= 17; ++digits) {
    std::snprintf(text, sizeof text, "%.*g", digits, value);
    if (std::strtod(text, nullptr) == value) break;
  }
  return text;
}

std::string excerpt(const std::string& text) {
  constexpr std::size_t kMostShown = 40;
  std::size_t end = std::min(text.size(), kMostShown);
  const auto is_within_character = [&](std::size_t i) {
    return i < text.size() && (static_cast<unsigned char>(text[i]) & 0xc0U) == 0x80U;  // UTF-8
  };
  while (end > 0 && is_within_character(end)) --end;
  std::string shown = text.substr(0, end);
  for (char& c : shown) {
    const auto code = static_cast<unsigned char>(c);
    if (code < 0x20 || code == 0x7f) c = '?';
  }
  return end < text.size() ? shown + "..." : shown;
}

std::string in_quotes(const std::string& text) { return "'" + excerpt(text) + "'"; }

std::string shown(const Eigen::Vector3d& v) {
  return "(" + shortest(v.x()) + ", " + shortest(v.y()) + ", " + shortest(v.z()) + ")";
}

namespace {

/// Product of four bounded numbers.
constexpr double kMostSaved = kMostMagnitude * kMostMagnitude * kMostMagnitude * kMostMagnitude;

void check_within(const std::string& field, double value, double most) {
  if (!std::isfinite(value)) refuse(field, "must be a finite number, got " + shortest(value));
  if (std::abs(value) > most) refuse_beyond(field, most, shortest(value));
}

void check_within(const std::string& field, const Eigen::Vector3d& value, double most) {
  if (!value.allFinite()) refuse(field, "must be finite numbers, got " + shown(value));
  if (value.lpNorm<Eigen::Infinity>() > most) refuse_beyond(field, most, shown(value));
}

}  // namespace

void check_finite(const std::string& field, double value) {
  check_within(field, value, kMostMagnitude);
}
void check_finite(const std::string& field, const Eigen::Vector3d& value) {
  check_within(field, value, kMostMagnitude);
}
void check_saved(const std::string& field, double value) { check_within(field, value, kMostSaved); }
void check_saved(const std::string& field, const Eigen::Vector3d& value) {
  check_within(field, value, kMostSaved);
}

void check_between(const std::string& field, double value, double least, double most) {
  if (!(value >= least && value <= most))
    refuse(field, "must be from " + shortest(least) + " to " + shortest(most) + ", got " +
                      shortest(value));
}

void check_positive(const std::string& field, double value) {
  if (!std::isfinite(value) || value <= 0.0)
    refuse(field, "must be a finite number > 0, got " + shortest(value));
  check_between(field, value, kLeastMagnitude, kMostMagnitude);
}

void check_not_negative(const std::string& field, double value) {
  if (!std::isfinite(value) || value < 0.0)
    refuse(field, "must be a finite number >= 0, got " + shortest(value));
  if (value > kMostMagnitude) refuse_beyond(field, kMostMagnitude, shortest(value));
}

void check_share(const std::string& field, double value) {
  if (!(value >= 0.0 && value <= 1.0))
    refuse(field, "must be between 0 and 1, got " + shortest(value));
}

void check_axis(const std::string& field, const Eigen::Vector3d& value) {
  check_finite(field, value);
  if (value.isZero(0.0)) refuse(field, "must not be (0, 0, 0)");
}

// Requires a tick of at least the rounding of the time, or time could stand still in a later tick.
bool is_rounding_within(double time, double time_step) {
  const double size = std::abs(time);
  return std::nextafter(size, kInfinity) - size <= time_step;
}

void check_next_tick(const std::string& field, double time, double time_step) {
  if (!has_next_tick(time, time_step))
    refuse(field, "a tick of " + shortest(time_step) + " s is lost beside a time of " +
                      shortest(time) + " s");
}

void make_unit(Eigen::Quaterniond* q) {
  if (std::abs(q->squaredNorm() - 1.0) > kUnitRounding) q->normalize();
}

void check_name(const std::string& field, const std::string& name) {
  if (name.empty()) refuse(field, "must not be empty, got ''");
  if (name == "world") refuse(field, "'world' is the world itself, choose another name");
  if (name.size() > kLongestName)
    refuse(field, "must be at most " + std::to_string(kLongestName) + " characters, got " +
                      std::to_string(name.size()));
  bool legal = is_name_start(name.front());
  for (const char c : name) legal = legal && is_name_character(c);
  if (!legal) refuse(field, "must match [A-Za-z0-9_][A-Za-z0-9_./-]*, got " + in_quotes(name));
}

namespace {

void check(const char* field, double value, ZeroOrPositive) {
  check_not_negative(field, value);
  if (value != 0.0) check_positive(field, value);
}
void check(const char* field, double value, Limit range) {
  if (value != range.none) check_finite(field, value);
}
template <class Value>
void check(const char*, const Value&, OwnRange) {}
void check(const char* field, const std::string& name, AnyValue) { check_name(field, name); }
void check(const char*, BodyType, AnyValue) {}
void check(const char* field, std::uint32_t bits, Positive) {
  if (bits == 0) refuse(field, "must be from 1 to 4294967295, got 0");
}
void check(const char*, const Shape& shape, AnyValue) { validate(shape); }
void check(const char*, const ShapePose& pose, AnyValue) { validate(pose); }
// The numbers of a surface are checked where it is made.
void check(const std::string& field, const std::shared_ptr<const ConvexHull>& surface, AnyValue) {
  if (!surface) refuse(field, "must be given");
}
template <class Value, class Range>
void check(const char* field, const std::optional<Value>& value, Range range);
void check(const std::string& field, const std::shared_ptr<const Compound::Parts>& parts,
           AnyValue) {
  if (!parts || parts->empty()) refuse(field, "must be at least one part");
  if (parts->size() > kMostParts)
    refuse(field, "must be at most " + std::to_string(kMostParts) + ", got " +
                      std::to_string(parts->size()));
  for (std::size_t i = 0; i < parts->size(); ++i) {
    const ShapePart& part = (*parts)[i];
    const Shape& shape = part.shape;
    try {
      if (form_of(shape) != ShapeForm::kSolid)
        refuse("shape", "a part must be a sphere, a box, a cylinder, a capsule or a hull");
      visit_fields(
          part, [](const char* key, const auto& value, auto range) { check(key, value, range); });
    } catch (const std::invalid_argument& error) {
      throw std::invalid_argument("shapes[" + std::to_string(i) + "]." + error.what());
    }
  }
}
void check(const char* field, const Eigen::Quaterniond& q, AnyValue) {
  if (!(std::abs(q.norm() - 1.0) <= 0.01))
    refuse(field, "must be a unit quaternion (x, y, z, w), got (" + shortest(q.x()) + ", " +
                      shortest(q.y()) + ", " + shortest(q.z()) + ", " + shortest(q.w()) + ")");
}
void check(const char* field, const std::array<double, 4>& color, Share) {
  for (const double value : color)
    if (!(value >= 0.0 && value <= 1.0))
      refuse(field, "must be four numbers from 0 to 1, got " + shortest(value));
}
void check(const char* field, const Motor& motor, AnyValue) {
  try {
    validate(motor);
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(field + std::string(".") + error.what());
  }
}
template <class Value, class Range>
void check(const char* field, const std::optional<Value>& value, Range range) {
  if (value) check(field, *value, range);
}

constexpr auto kCheck = [](const char* field, const auto& value, auto range) {
  check(field, value, range);
};

}  // namespace

void validate(const BodyState& state) { visit_fields(state, kCheck); }

void validate(const ShapePose& pose) { visit_fields(pose, kCheck); }

void validate(const Shape& shape) {
  const std::string whose = std::holds_alternative<Compound>(shape) ? "" : "shape.";
  const auto check_size = [&](const char* key, const auto& size, auto range) {
    check(whose + key, size, range);
  };
  std::visit([&](const auto& of_kind) { visit_fields(of_kind, check_size); }, shape);
}

namespace {

void check_shape_pose(const Body& body) {
  if (!body.shape_pose) return;
  const ShapeForm form = form_of(body.shape);
  if (form == ShapeForm::kCompound) refuse("shape_pose", "each of several shapes has its own");
  if (form != ShapeForm::kSolid)
    refuse("shape_pose", "only a sphere, a box, a cylinder, a capsule or a hull has one");
  if (body.type == BodyType::kDynamic && body.inertia.isZero(0.0))
    refuse("inertia", "must be given for a shape that is beside the centre of mass");
}

}  // namespace

void validate(const Body& body) {
  visit_fields(body, kCheck);
  check_shape_pose(body);
  if (body.type == BodyType::kDynamic) {
    check_positive("mass", body.mass);
    if (is_half_space(body.shape))
      refuse("type", "a plane is unbounded and must be static or kinematic, got dynamic");
  } else {
    check_not_negative("mass", body.mass);
  }
  if (!body.inertia.allFinite())
    refuse("inertia", "must be finite numbers, got " + shown(body.inertia));
  if (!body.inertia.isZero(0.0) && !(body.inertia.minCoeff() > 0.0))
    refuse("inertia", "must be three numbers > 0, or all 0 to follow from the shape, got " +
                          shown(body.inertia));
  if (!body.inertia.isZero(0.0) &&
      (body.inertia.minCoeff() < kLeastInertia || body.inertia.maxCoeff() > kMostInertia))
    refuse("inertia", "must be from " + shortest(kLeastInertia) + " to " + shortest(kMostInertia) +
                          ", got " + shown(body.inertia));
  const bool turns = body.type != BodyType::kDynamic || !body.inertia.isZero(0.0) ||
                     !unit_inertia(body.shape).isZero(0.0);
  if (!turns && !body.state.angular_velocity.isZero(0.0))
    refuse("angular_velocity",
           "a point mass without inertia cannot turn, got " + shown(body.state.angular_velocity));
  if (body.type == BodyType::kStatic) {
    if (!body.state.linear_velocity.isZero(0.0))
      refuse("linear_velocity",
             "a static body does not move, got " + shown(body.state.linear_velocity));
    if (!body.state.angular_velocity.isZero(0.0))
      refuse("angular_velocity",
             "a static body does not turn, got " + shown(body.state.angular_velocity));
  }
}

void validate(const Motor& motor) {
  visit_fields(motor, kCheck);
  const auto only_one = [](const char* field, double value, const char* other) {
    refuse(field, "a motor goes by velocity, to a position or with a force, got " +
                      shortest(value) + " beside " + other);
  };
  if (motor.position && motor.force) only_one("force", *motor.force, "position");
  if (motor.position && motor.is_moving())
    only_one("position", *motor.position, "bias or amplitude");
  if (motor.force && motor.is_moving()) only_one("force", *motor.force, "bias or amplitude");
  for (const auto& [field, value] : {std::pair("servo_frequency", motor.servo_frequency),
                                     {"servo_stiffness", motor.servo_stiffness},
                                     {"servo_damping", motor.servo_damping}})
    if (value > 0.0 && !motor.position) refuse(field, "needs a position, got " + shortest(value));
  if (motor.servo_frequency > 0.0 && (motor.servo_stiffness > 0.0 || motor.servo_damping > 0.0))
    refuse("servo_frequency", "a servo has this, or servo_stiffness and servo_damping, got " +
                                  shortest(motor.servo_frequency) + " beside these");
  if (motor.servo_damping > 0.0 && motor.servo_stiffness == 0.0)
    refuse("servo_damping", "needs servo_stiffness > 0, got " + shortest(motor.servo_damping));
}

void validate(const CoordinateLaw& law) {
  visit_fields(law, kCheck);
  if (!(law.lower < law.upper))
    refuse("upper", "must be above lower " + shortest(law.lower) + ", got " + shortest(law.upper));
  if (law.damping_ratio > 0.0 && law.frequency == 0.0)
    refuse("damping_ratio", "needs a frequency > 0, got " + shortest(law.damping_ratio));
  if (law.frequency > 0.0 && (law.stiffness > 0.0 || law.damping > 0.0))
    refuse("frequency", "a spring has frequency and damping_ratio, or stiffness and damping, got " +
                            shortest(law.frequency) + " beside these");
}

namespace {

// Checks the settings of a spring that only pulls.
void validate_tension_spring(const DistanceJoint& joint) {
  if (!joint.is_soft())
    refuse("one_sided",
           "only a spring is one-sided, got true without frequency, stiffness and damping");
  const bool is_lower = joint.min_length > 0.0;
  if (joint.is_limited())
    refuse(is_lower ? "min_length" : "max_length",
           "a one-sided spring has its length and no limits, got " +
               shortest(is_lower ? joint.min_length : joint.max_length));
  if (joint.length) check_positive("length", *joint.length);
}

void validate_distance(const DistanceJoint& joint) {
  visit_fields(joint, kCheck);
  if (!(joint.max_length > 0.0))
    refuse("max_length", "must be a number > 0, got " + shortest(joint.max_length));
  if (std::isfinite(joint.max_length)) check_positive("max_length", joint.max_length);
  if (joint.max_length < joint.min_length)
    refuse("max_length", "must not be below min_length " + shortest(joint.min_length) + ", got " +
                             shortest(joint.max_length));
  if (joint.damping_ratio > 0.0 && !(joint.frequency > 0.0))
    refuse("damping_ratio", "needs a frequency > 0, got " + shortest(joint.damping_ratio));
  if (joint.frequency > 0.0 && (joint.stiffness > 0.0 || joint.damping > 0.0))
    refuse("frequency", "a spring has frequency and damping_ratio, or stiffness and damping, got " +
                            shortest(joint.frequency) + " beside these");
  if (joint.is_limited() && !joint.is_soft() && joint.length)
    refuse("length",
           "a joint with min_length or max_length is free between them and has no "
           "length of its own, got " +
               shortest(*joint.length));
  if (joint.one_sided) validate_tension_spring(joint);
}

// Rejects a motor in Joint::motor of a joint that has no length.
[[noreturn]] void refuse_motor(JointKind kind, const std::string& got) {
  refuse("motor", "a " + std::string(name(kind)) + " joint has " +
                      (info(kind).coordinates > 0 ? "its motors in coordinates" : "none") +
                      ", got " + got);
}

// Rejects settings of Joint::motor beside those of a velocity motor.
void reject_position_and_force(const Motor& motor, JointKind kind) {
  const auto reject = [&](const auto& field) {
    const std::optional<double> value = motor.*field.member;
    if (are_same(value, std::optional<double>(Motor{}.*field.member))) return;
    if (!has_length(kind)) refuse_motor(kind, field.key + (" " + shortest(*value)));
    refuse(field.key,
           "a distance joint has a velocity motor alone; one with free: true (kind kFreeDistance) "
           "may have this, got " +
               shortest(*value));
  };
  std::apply([&](const auto&... field) { (reject(field), ...); }, kPositionOrForceMotor);
}

// Checks the motor of a distance joint; other kinds have motors on their coordinates.
void validate_motor(const Joint& joint) {
  const Motor& m = joint.motor;
  reject_position_and_force(m, joint.kind);
  validate(m);
  if (has_length(joint.kind) && joint.distance.one_sided && m.max_force > 0.0)
    refuse("max_force", "a one-sided spring has no force limit, got " + shortest(m.max_force));
  if (has_length(joint.kind)) return;
  if (m.is_moving() || m.max_force != 0.0)
    refuse_motor(joint.kind, "bias " + shortest(m.bias) + ", amplitude " + shortest(m.amplitude) +
                                 ", max_force " + shortest(m.max_force));
}

void validate_coordinates(const Joint& joint) {
  for (std::size_t i = 0; i < kMaxCoordinates; ++i) {
    const CoordinateLaw& law = joint.coordinates[i];
    validate(law);
    if (static_cast<int>(i) >= info(joint.kind).coordinates && !law.is_none())
      refuse("coordinates", "a " + std::string(name(joint.kind)) + " joint has " +
                                std::to_string(info(joint.kind).coordinates) +
                                " with laws, got one for number " + std::to_string(i));
  }
}

void validate_coupling(const Joint& joint) {
  if (joint.coupling.value) check_finite("value", *joint.coupling.value);
  if (info(joint.kind).couples_joints) {
    check_finite("ratio", joint.coupling.ratio);
    if (std::abs(joint.coupling.ratio) < kLeastMagnitude)
      refuse("ratio", "must not be 0, got " + shortest(joint.coupling.ratio));
  }
  if (joint.coupling.one_sided) {
    if (!info(joint.kind).couples_lengths)
      refuse("one_sided",
             "only a pulley is one-sided, got true for a " + std::string(name(joint.kind)));
    if (joint.coupling.ratio < 0.0)
      refuse("ratio", "must be > 0 for a one-sided pulley, whose rope pulls at both ends, got " +
                          shortest(joint.coupling.ratio));
  }
  if (!info(joint.kind).has_pitch) return;
  check_finite("pitch", joint.pitch);
  if (std::abs(joint.pitch) < kLeastMagnitude)
    refuse("pitch", "must not be 0 [m a turn], got " + shortest(joint.pitch));
}

}  // namespace

void validate(const Joint& joint) {
  check_name("name", joint.name);
  check_finite("anchor_a", joint.anchor_a);
  check_finite("anchor_b", joint.anchor_b);
  if (const DistanceJoint* distance = if_distance(joint)) validate_distance(*distance);
  check("frame_a", joint.frame_a, AnyValue{});
  check("frame_b", joint.frame_b, AnyValue{});
  if (joint.axis_b) {
    check_axis("axis_b", *joint.axis_b);
    if (joint.frame_b) refuse("axis_b", "give this or frame_b, not both");
  }
  if (info(joint.kind).has_two_axes && !joint.axis_b && !joint.frame_b)
    refuse("axis_b", "a " + std::string(name(joint.kind)) +
                         " joint needs it: which axis of body B stands at a right angle to axis_a");
  validate_motor(joint);
  validate_coordinates(joint);
  validate_coupling(joint);
  visit_list(kJointSettings, joint, kCheck);
  if (is_custom_force(joint.kind) && joint.break_force + joint.break_torque > 0.0)
    refuse("break_force", "a custom force does not break, got " + shortest(joint.break_force) +
                              " and a break_torque of " + shortest(joint.break_torque));
  if (joint.break_torque > 0.0 && !bears_torque(joint.kind))
    refuse("break_torque",
           (info(joint.kind).couples_joints ? "a " + std::string(name(joint.kind)) +
                                                  " breaks by its effort, beyond break_force, got "
                                            : "a distance joint has no torque, got ") +
               shortest(joint.break_torque));
}

}  // namespace constraint_sim::engine
