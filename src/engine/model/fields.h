#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <tuple>
#include <type_traits>

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/joint.h"
#include "constraint_sim/engine/options.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {

// The single list of fields of each struct that scenes set, as visit_options() is of options.
// Scenes, checks, equality, snapshots, Python's keywords and the keys of set_constraint_properties
// go through these lists; test/engine/test_fields.cpp compares them with the structs.

/// A field of a struct: key in scenes, member and range of its values.
template <class Struct, class Value, class Range>
struct Field {
  const char* key;
  Value Struct::*member;
  Range range;
};
template <class Struct, class Value, class Range>
Field(const char*, Value Struct::*, Range) -> Field<Struct, Value, Range>;

// Ranges beside the ranges of options.
struct ZeroOrPositive {};  ///< 0, or a number whose square is not 0
struct Limit {             ///< finite, or `none`: no limit
  double none;
};
struct OwnRange {};  ///< checked in validate() of the struct
struct Beside {};    ///< a struct whose keys stand beside the other keys

/// Fields of a struct, in the order of its members and of saved scenes; nullptr: no list.
template <class Struct>
inline constexpr std::nullptr_t kFields = nullptr;
template <class Struct>
inline constexpr bool kHasFields = !std::is_null_pointer_v<decltype(kFields<Struct>)>;

template <>
inline constexpr auto kFields<Point> = std::tuple{};
template <>
inline constexpr auto kFields<Sphere> = std::tuple{Field{"radius", &Sphere::radius, Positive{}}};
template <>
inline constexpr auto kFields<Box> = std::tuple{Field{"size", &Box::size, Positive{}}};
template <>
inline constexpr auto kFields<Plane> = std::tuple{};
template <>
inline constexpr auto kFields<Cylinder> = std::tuple{
    Field{"radius", &Cylinder::radius, Positive{}},
    Field{"length", &Cylinder::length, Positive{}},
};

template <>
inline constexpr auto kFields<Capsule> = std::tuple{
    Field{"radius", &Capsule::radius, Positive{}},
    Field{"length", &Capsule::length, Positive{}},
};

template <>
inline constexpr auto kFields<Hull> = std::tuple{Field{"vertices", &Hull::surface, AnyValue{}}};

template <>
inline constexpr auto kFields<Compound> = std::tuple{Field{"shapes", &Compound::parts, AnyValue{}}};

template <>
inline constexpr auto kFields<ShapePose> = std::tuple{
    Field{"position", &ShapePose::position, AnyValue{}},
    Field{"orientation", &ShapePose::orientation, AnyValue{}},
};

template <>
inline constexpr auto kFields<ShapePart> = std::tuple{
    Field{"shape", &ShapePart::shape, AnyValue{}},
    Field{"shape_pose", &ShapePart::pose, AnyValue{}},
    Field{"friction", &ShapePart::friction, NotNegative{}},
    Field{"restitution", &ShapePart::restitution, Share{}},
};

template <>
inline constexpr auto kFields<BodyState> = std::tuple{
    Field{"position", &BodyState::position, AnyValue{}},
    Field{"orientation", &BodyState::orientation, AnyValue{}},
    Field{"linear_velocity", &BodyState::linear_velocity, AnyValue{}},
    Field{"angular_velocity", &BodyState::angular_velocity, AnyValue{}},
};

template <>
inline constexpr auto kFields<Body> = std::tuple{
    Field{"name", &Body::name, AnyValue{}},
    Field{"type", &Body::type, AnyValue{}},
    Field{"shape", &Body::shape, AnyValue{}},
    Field{"shape_pose", &Body::shape_pose, AnyValue{}},
    Field{"mass", &Body::mass, OwnRange{}},
    Field{"inertia", &Body::inertia, OwnRange{}},
    Field{"state", &Body::state, Beside{}},
    Field{"friction", &Body::friction, NotNegative{}},
    Field{"restitution", &Body::restitution, Share{}},
    Field{"no_collision", &Body::no_collision, AnyValue{}},
    Field{"collision_groups", &Body::collision_groups, Positive{}},
    Field{"collision_mask", &Body::collision_mask, Positive{}},
    Field{"gravity_compensation", &Body::gravity_compensation, Share{}},
    Field{"color", &Body::color, Share{}},
};

template <>
inline constexpr auto kFields<DistanceJoint> = std::tuple{
    Field{"length", &DistanceJoint::length, ZeroOrPositive{}},
    Field{"min_length", &DistanceJoint::min_length, NotNegative{}},
    Field{"max_length", &DistanceJoint::max_length, OwnRange{}},
    Field{"frequency", &DistanceJoint::frequency, ZeroOrPositive{}},
    Field{"damping_ratio", &DistanceJoint::damping_ratio, NotNegative{}},
    Field{"stiffness", &DistanceJoint::stiffness, NotNegative{}},
    Field{"damping", &DistanceJoint::damping, NotNegative{}},
    Field{"one_sided", &DistanceJoint::one_sided, AnyValue{}},
};

/// Fields of a velocity motor, the only motor that kind kDistance has.
inline constexpr std::tuple kVelocityMotor{
    Field{"bias", &Motor::bias, AnyValue{}},
    Field{"amplitude", &Motor::amplitude, AnyValue{}},
    Field{"frequency", &Motor::frequency, NotNegative{}},
    Field{"phase", &Motor::phase, AnyValue{}},
    Field{"max_force", &Motor::max_force, NotNegative{}},
    Field{"timeout", &Motor::timeout, NotNegative{}},
};

/// Further fields of a motor of a coordinate, which goes by position or force.
inline constexpr std::tuple kPositionOrForceMotor{
    Field{"position", &Motor::position, AnyValue{}},
    Field{"servo_frequency", &Motor::servo_frequency, NotNegative{}},
    Field{"servo_damping_ratio", &Motor::servo_damping_ratio, NotNegative{}},
    Field{"servo_stiffness", &Motor::servo_stiffness, NotNegative{}},
    Field{"servo_damping", &Motor::servo_damping, NotNegative{}},
    Field{"force", &Motor::force, AnyValue{}},
};
template <>
inline constexpr auto kFields<Motor> = std::tuple_cat(kVelocityMotor, kPositionOrForceMotor);

template <>
inline constexpr auto kFields<CoordinateLaw> = std::tuple{
    Field{"motor", &CoordinateLaw::motor, AnyValue{}},
    Field{"lower", &CoordinateLaw::lower, Limit{-kInfinity}},
    Field{"upper", &CoordinateLaw::upper, Limit{kInfinity}},
    Field{"limit_restitution", &CoordinateLaw::limit_restitution, Share{}},
    Field{"friction", &CoordinateLaw::friction, NotNegative{}},
    Field{"damping", &CoordinateLaw::damping, NotNegative{}},
    Field{"stiffness", &CoordinateLaw::stiffness, NotNegative{}},
    Field{"rest", &CoordinateLaw::rest, AnyValue{}},
    Field{"frequency", &CoordinateLaw::frequency, NotNegative{}},
    Field{"damping_ratio", &CoordinateLaw::damping_ratio, NotNegative{}},
    Field{"position", &CoordinateLaw::position, AnyValue{}},
    Field{"zero", &CoordinateLaw::zero, AnyValue{}},
};

/// Settings of a joint that all kinds have and that may change while the joint exists.
inline constexpr std::tuple kJointSettings{
    Field{"baumgarte", &Joint::baumgarte, Share{}},
    Field{"break_force", &Joint::break_force, NotNegative{}},
    Field{"break_torque", &Joint::break_torque, NotNegative{}},
    Field{"collide_connected", &Joint::collide_connected, AnyValue{}},
    Field{"enabled", &Joint::enabled, AnyValue{}},
};

template <class Struct, class Visit>
void visit_fields(Struct& object, Visit visit);

/// Calls visit(key, member of `object`, range) for each field of a list.
template <class List, class Struct, class Visit>
void visit_list(const List& list, Struct& object, Visit visit) {
  const auto visit_field = [&](const auto& field) {
    if constexpr (std::is_same_v<decltype(field.range), Beside>)
      visit_fields(object.*field.member, visit);
    else
      visit(field.key, object.*field.member, field.range);
  };
  std::apply([&](const auto&... field) { (visit_field(field), ...); }, list);
}
/// Visits all fields of a struct with a list, const or not.
template <class Struct, class Visit>
void visit_fields(Struct& object, Visit visit) {
  visit_list(kFields<std::remove_const_t<Struct>>, object, visit);
}

/// Whether values are equal, field by field and number by number. 0 and −0 count as equal.
inline bool are_same(const std::shared_ptr<const ConvexHull>& a,
                     const std::shared_ptr<const ConvexHull>& b) {
  return a == b || (a && b && a->vertices() == b->vertices());
}
template <class Value>
bool are_same(const std::optional<Value>& a, const std::optional<Value>& b);
template <class Value>
bool are_same(const Value& a, const Value& b) {
  if constexpr (kHasFields<Value>)
    return std::apply(
        [&](const auto&... field) { return (are_same(a.*field.member, b.*field.member) && ...); },
        kFields<Value>);
  else
    return a == b;
}
template <class Value>
bool are_same(const std::optional<Value>& a, const std::optional<Value>& b) {
  return a && b ? are_same(*a, *b) : a.has_value() == b.has_value();
}

}  // namespace constraint_sim::engine
