#include "constraint_sim/engine/plan.h"

#include <array>
#include <cmath>
#include <cstdio>
#include <map>
#include <sstream>
#include <type_traits>
#include <utility>

#include "engine/constraints/closing_errors.h"
#include "engine/constraints/contact.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/constraints/law.h"
#include "engine/islands/method_choice.h"
#include "engine/math/numbers.h"
#include "engine/model/impulse_method.h"
#include "engine/model/shape_names.h"
#include "engine/model/shape_properties.h"
#include "engine/model/validate.h"

namespace constraint_sim::engine {
namespace {

constexpr double kTold = kClosedError;  // [m or rad] smaller errors of joints are not reported

/// Numbers of bodies, joints and islands of a world, by kind.
struct Counts {
  int dynamic_bodies = 0, static_bodies = 0, kinematic_bodies = 0;
  int colliding = 0, colliding_dynamic = 0, colliding_boxes = 0, colliding_cylinders = 0,
      colliding_hulls = 0, colliding_capsules = 0, colliding_planes = 0, rough = 0, turning = 0;
  int rods = 0, limited = 0, springs = 0, motors = 0, broken = 0, disabled = 0;
  std::array<int, kShapeNames.size()> shapes{};  // by kind
  int rubbing = 0;                               // coordinates with friction
  std::array<int, kJointKindCount> joints{};     // by kind
  std::array<int, kMethodCount> islands{};       // awake islands, by method
  int asleep = 0;

  bool collides() const { return colliding >= 2 && colliding_dynamic >= 1; }
  bool turns() const { return turning > 0; }
};

template <class Kind>
bool has_part(const Shape& shape) {
  for (int part = 0; part < static_cast<int>(part_count(shape)); ++part)
    if (std::holds_alternative<Kind>(part_of(shape, part))) return true;
  return false;
}

bool has_friction(const Body& body) {
  for (int part = 0; part < static_cast<int>(part_count(body.shape)); ++part)
    if (friction_of(body, part) > 0.0) return true;
  return false;
}

void count_body(const Body& body, Counts* counts) {
  const bool is_dynamic = body.type == BodyType::kDynamic;
  counts->dynamic_bodies += is_dynamic;
  counts->static_bodies += body.type == BodyType::kStatic;
  counts->kinematic_bodies += body.type == BodyType::kKinematic;
  ++counts->shapes[body.shape.index()];

  const bool has_inertia = !body.inertia.isZero(0.0) || !unit_inertia(body.shape).isZero(0.0);
  counts->turning += is_dynamic && has_inertia;
  if (body.no_collision || !has_surface(body.shape)) return;
  ++counts->colliding;
  counts->colliding_dynamic += is_dynamic;
  counts->colliding_boxes += has_part<Box>(body.shape);
  counts->colliding_cylinders += has_part<Cylinder>(body.shape);
  counts->colliding_hulls += has_part<Hull>(body.shape);
  counts->colliding_capsules += has_part<Capsule>(body.shape);
  counts->colliding_planes += has_part<Plane>(body.shape);
  counts->rough += has_friction(body);
}

void count_law(const CoordinateLaw& law, Counts* counts) {
  const bool has_servo = law.motor && law.motor->is_servo();
  counts->motors += law.motor.has_value();
  counts->springs += law.stiffness > 0.0 || law.damping > 0.0 || has_servo;
  counts->limited += law.is_limited();
  counts->rubbing += law.friction > 0.0;
}

void count_joint(const Joint& joint, const JointState& state, Counts* counts) {
  counts->motors += joint.motor.bias != 0.0 || joint.motor.amplitude != 0.0;
  counts->broken += state.broken;
  counts->disabled += !joint.enabled;
  ++counts->joints[static_cast<std::size_t>(joint.kind)];
  for (std::size_t i = 0; i < static_cast<std::size_t>(info(joint.kind).coordinates); ++i)
    count_law(joint.coordinates[i], counts);
  counts->limited += joint.coupling.one_sided;
  if (!has_length(joint.kind)) return;
  if (!length_spring(joint).is_none())
    ++counts->springs;
  else if (has_limits(joint))
    ++counts->limited;
  else
    ++counts->rods;
}

Counts count(const World& world) {
  Counts counts;
  for (const BodyId id : world.body_ids()) count_body(world.body(id), &counts);
  for (const JointId id : world.joint_ids())
    count_joint(world.joint(id), world.joint_state(id), &counts);
  for (const Island& island : world.islands()) {
    if (island.why == MethodReason::kAtRest)
      ++counts.asleep;
    else
      ++counts.islands[static_cast<std::size_t>(island.method)];
  }
  return counts;
}

std::string shown_value(bool value) { return value ? "true" : "false"; }
std::string shown_value(int value) { return std::to_string(value); }
std::string shown_value(double value) { return std::isinf(value) ? ".inf" : shortest(value); }

/// Writes the requested method, and the options of methods for islands without contacts.
void write_method(const WorldOptions& options, std::ostream& out) {
  out << "method: {asked_for: " << name(options.method);
  visit_options(options, [&](const OptionInfo& info, const auto& value, auto) {
    if constexpr (std::is_arithmetic_v<std::decay_t<decltype(value)>>)
      if (info.read_by == Method::kRungeKutta || info.read_by == Method::kEnergyMomentum)
        out << ", " << info.name << ": " << shown_value(value);
  });
  out << "}\n";
}

/// Writes a line for all islands with equal method and reason.
void write_islands(const World& world, std::ostream& out) {
  struct Sum {
    int islands = 0;
    std::uint32_t bodies = 0, joints = 0;
  };
  std::map<std::pair<Method, MethodReason>, Sum> sums;
  for (const Island& island : world.islands()) {
    Sum& sum = sums[{island.method, island.why}];
    ++sum.islands;
    sum.bodies += island.bodies;
    sum.joints += island.joints;
  }
  out << "islands:" << (sums.empty() ? " []" : "") << "\n";
  for (const auto& [key, sum] : sums)
    out << "  - {method: " << name(key.first) << ", why: " << to_string(key.second)
        << ", count: " << sum.islands << ", bodies: " << sum.bodies
        << ", constraints: " << sum.joints << "}\n";
}

}  // namespace

std::string explain(const World& world) {
  const Counts counts = count(world);
  std::ostringstream out;
  write_method(world.options(), out);
  write_islands(world, out);
  out << "bodies: {dynamic: " << counts.dynamic_bodies << ", static: " << counts.static_bodies
      << ", kinematic: " << counts.kinematic_bodies << "}\n";
  for (std::size_t i = 0; i < kShapeNames.size(); ++i)
    out << (i == 0 ? "shapes: {" : ", ") << kShapeNames[i] << ": " << counts.shapes[i];
  out << "}\n";
  out << "constraints: {rod: " << counts.rods << ", limited: " << counts.limited
      << ", spring: " << counts.springs;
  for (std::size_t i = 0; i < kJointKindCount; ++i) {  // balls always, others where there are any
    const auto kind = static_cast<JointKind>(i);
    const int number = counts.joints[i];
    const RowsForm form = forms(kind).form;
    if (form == RowsForm::kPoint || (form != RowsForm::kDistance && number > 0))
      out << ", " << name(kind) << ": " << number;
  }
  if (counts.rubbing > 0) out << ", friction: " << counts.rubbing;
  if (counts.disabled > 0) out << ", disabled: " << counts.disabled;
  out << ", motor: " << counts.motors << ", broken: " << counts.broken << "}\n";
  out << "wrenches: " << world.wrenches().size() << "\n";
  out << std::boolalpha << "collision: " << counts.collides() << "\n";
  out << "rotation: " << counts.turns() << "\n";
  const std::vector<std::string> lines = left_out(world);
  out << "left_out:" << (lines.empty() ? " []" : "") << "\n";
  for (const std::string& line : lines) out << "  - \"" << line << "\"\n";
  return out.str();
}

std::vector<std::string> left_out(const World& world) {
  const Counts counts = count(world);
  std::vector<std::string> lines;
  const auto leave_out = [&](bool is_left_out, const std::string& what_and_why) {
    if (is_left_out) lines.push_back(what_and_why);
  };
  leave_out(!counts.collides(), "collision: no dynamic body has a shape that another could touch");
  leave_out(counts.colliding_boxes == 0, "boxes: none that could touch something");
  leave_out(counts.rough < 2 && counts.rubbing == 0,
            "friction: no two bodies that could touch have it");
  leave_out(world.joint_ids().empty(), "constraints: there are none");
  leave_out(counts.limited == 0, "limits: no constraint has any");
  leave_out(counts.springs == 0, "springs: there are none");
  leave_out(counts.motors == 0, "motors: no constraint has one");
  leave_out(!counts.turns(), "rotation: no dynamic body has an inertia");
  leave_out(world.wrenches().empty(), "wrenches: there are none");
  for (const Method method : {Method::kRungeKutta, Method::kEnergyMomentum, Method::kEventDriven,
                              impulses_of(world.options())})
    leave_out(counts.islands[static_cast<std::size_t>(method)] == 0,
              std::string(name(method)) + ": advances no island");
  const bool collides_by_events = follows_contacts(world.options()) && counts.collides();
  leave_out(collides_by_events && counts.colliding_cylinders > 0,
            "events of cylinders: time_stepping advances contacts with a cylinder");
  leave_out(collides_by_events && counts.colliding_hulls > 0,
            "events of hulls: time_stepping advances contacts with a hull");
  leave_out(collides_by_events && counts.colliding_capsules > 0 &&
                counts.colliding - counts.colliding_planes > 1,
            "events of capsules: time_stepping advances contacts of a capsule with shapes other "
            "than planes");
  const std::string asleep = std::to_string(counts.asleep);
  leave_out(counts.asleep > 0, "islands: " + asleep + " at rest, until something touches them");
  return lines;
}

std::vector<std::string> doubtful_settings(const World& world) {
  constexpr double kInertiaRounding = 1e-9;  // relative rounding of inertias typed by hand
  std::vector<std::string> lines;
  for (const BodyId id : world.body_ids()) {
    const Body& body = world.body(id);
    const Eigen::Vector3d& I = body.inertia;
    const double excess = 2.0 * I.maxCoeff() - I.sum();  // over the sum of the other two
    if (body.type == BodyType::kDynamic && excess > kInertiaRounding * I.maxCoeff())
      lines.push_back("body " + in_quotes(body.name) + ": inertia " + shown(I) +
                      " is that of no distribution of mass: its largest exceeds the sum of the "
                      "others");
  }
  return lines;
}

namespace {

std::string shown_figure(double value) {
  char figure[32];
  std::snprintf(figure, sizeof figure, "%.3g", value);
  return figure;
}

/// Describes the errors of a joint of the kind table at the current poses, one entry per part.
std::vector<std::string> open_parts(const World& world, const Joint& joint,
                                    const JointState& state) {
  constexpr double kDegrees = 180.0 / kPi;
  std::vector<std::string> parts;
  const JointForms& kind = forms(joint.kind);
  const JointVectors vectors(joint, world.state(joint.body_a), world.state(joint.body_b));
  Eigen::Vector3d open = Eigen::Vector3d::Zero();
  for (int k = 0; k < kind.separation_rows; ++k)
    open[k] = value(kind.row[static_cast<std::size_t>(k)], vectors);
  if (open.norm() > kTold) parts.push_back("anchors " + shown_figure(open.norm()) + " m apart");
  if (state.angle_error > kTold)
    parts.push_back("axes " + shown_figure(kDegrees * state.angle_error) + " degrees off");
  for (std::size_t i = 0; i < static_cast<std::size_t>(kind.coordinates); ++i) {
    const CoordinateLaw& law = joint.coordinates[i];
    const CoordinateState& coordinate = state.coordinates[i];
    const auto say = [&](double off, const char* how) {
      if (std::abs(off) > kTold)
        parts.push_back("coordinate " + std::to_string(i) + " " + shown_figure(std::abs(off)) +
                        (kind.coordinate[i].is_angle ? " rad" : " m") + how);
    };
    const bool is_held = law.motor && law.motor->is_rigid();
    if (is_held) say(coordinate.position - coordinate.held, " from where its motor holds it");
    if (!is_held || may_lose_motion(law))
      say(beyond_limits(law, coordinate.position), " beyond its limit");
  }
  return parts;
}

}  // namespace

namespace {

// Whether the value of a coupling is an angle.
bool starts_with_angle(const World& world, const Joint& joint) {
  return info(joint.kind).couples_joints &&
         info(world.joint(joint.coupling.first).kind).is_angle[0];
}

}  // namespace

std::string text_of_opening(const World& world, JointId id) {
  const Joint& joint = world.joint(id);
  const JointData& state = joint_data(world, id);
  if (!state.closing) return "";
  std::vector<std::string> parts;
  if (has_length(joint.kind))
    parts.push_back("length " + shown_figure(std::abs(state.error)) + " m off");
  else
    parts = open_parts(world, joint, state);
  if (info(joint.kind).couples && std::abs(state.to_close.coupling) > kTold)
    parts.push_back("coupling " + shown_figure(std::abs(state.to_close.coupling)) +
                    (starts_with_angle(world, joint) ? " rad off" : " m off"));
  std::string line;
  for (const std::string& part : parts) line += (line.empty() ? "" : ", ") + part;
  const WorldOptions& options = world.options();
  const double share = joint.baumgarte.value_or(options.baumgarte);
  line += options.method == Method::kSequentialImpulses
              ? "; closes by the share " + shown_figure(share) + " of it a step"
              : "; closes in " + shown_figure(options.closing_time) + " s";
  const bool is_reversed =
      forms(joint.kind).alignment == Alignment::kParallelZ && state.angle_error > 0.5 * kPi;
  if (is_reversed) line += "; was the axis meant the other way round?";
  return line;
}

}  // namespace constraint_sim::engine
