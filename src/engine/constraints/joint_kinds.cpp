#include "engine/constraints/joint_kinds.h"

#include <cmath>
#include <initializer_list>

#include "engine/math/elementary.h"
#include "engine/model/mass_properties.h"
#include "engine/model/validate.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Names as in mathematics: d, axes of A, B and the world, and coordinates.
// NOLINTBEGIN(readability-identifier-naming)
constexpr VectorRef d{VectorKind::kSeparation, 0};
constexpr VectorRef xA{VectorKind::kAxisA, 0}, yA{VectorKind::kAxisA, 1}, zA{VectorKind::kAxisA, 2};
constexpr VectorRef xB{VectorKind::kAxisB, 0}, yB{VectorKind::kAxisB, 1}, zB{VectorKind::kAxisB, 2};
constexpr VectorRef xW{VectorKind::kWorldAxis, 0}, yW{VectorKind::kWorldAxis, 1},
    zW{VectorKind::kWorldAxis, 2};
constexpr VectorRef custom{VectorKind::kCustom, 0};
constexpr ScalarForm along_x{RowForm{xA, d}}, along_y{RowForm{yA, d}}, along_z{RowForm{zA, d}};
constexpr ScalarForm length{LengthForm{}};
// Angles, as sine and cosine by products u·v: `angle` is the twist of B about z_A. In a
// universal joint `angle_1` is the rotation of the cross about z_A, `angle_2` the rotation of B
// about z_B.
constexpr ScalarForm angle{
    AngleForm{{{{{xA, xB}, 0.5}, {{yA, yB}, 0.5}}}, {{{{yA, xB}, 0.5}, {{xA, yB}, -0.5}}}, true}};
constexpr ScalarForm angle_1{AngleForm{{{{{xA, zB}, 1.0}, {}}}, {{{{yA, zB}, 1.0}, {}}}}};
constexpr ScalarForm angle_2{AngleForm{{{{{xB, zA}, 1.0}, {}}}, {{{{yB, zA}, -1.0}, {}}}}};

// NOLINTEND(readability-identifier-naming)

// Coordinates that a joint couples by a row.
enum class Couples : std::uint8_t {
  kNothing,
  kJoints,   // the first coordinates of two other joints
  kLengths,  // lengths of two other joints
  kOwn,      // its own two coordinates, by a pitch
};

constexpr bool is_axis(VectorRef u) {
  return u.kind == VectorKind::kAxisA || u.kind == VectorKind::kAxisB ||
         u.kind == VectorKind::kCustom;
}

constexpr JointForms kind(const char* name, std::initializer_list<RowForm> rows,
                          Alignment alignment, std::initializer_list<ScalarForm> coordinates,
                          Couples couples = Couples::kNothing) {
  JointForms made;
  made.name = name;
  made.alignment = alignment;
  made.has_two_axes = alignment == Alignment::kPerpendicularZ;
  made.couples = couples != Couples::kNothing;
  made.couples_joints = couples == Couples::kJoints || couples == Couples::kLengths;
  made.couples_lengths = couples == Couples::kLengths;
  made.has_pitch = couples == Couples::kOwn;
  for (const RowForm& row : rows) {
    made.row[static_cast<std::size_t>(made.rows++)] = row;
    made.separation_rows += row.has_separation() ? 1 : 0;
    made.has_frames = made.has_frames || is_axis(row.u) || is_axis(row.v);
  }
  if (made.rows == 1 && made.row[0].is_square()) made.form = RowsForm::kDistance;
  if (made.rows == 3 && made.separation_rows == 3 && !made.has_frames) made.form = RowsForm::kPoint;
  for (const ScalarForm& coordinate : coordinates) {
    const auto i = static_cast<std::size_t>(made.coordinates++);
    made.coordinate[i] = coordinate;
    made.is_angle[i] = coordinate.is_angle;
    made.is_free_length = made.is_free_length || coordinate.is_length;
  }
  for (int k = 0; k < made.rows + made.coordinates; ++k)
    made.function[static_cast<std::size_t>(k)] =
        k < made.rows ? ScalarForm(made.row[static_cast<std::size_t>(k)])
                      : made.coordinate[static_cast<std::size_t>(k - made.rows)];
  return made;
}

constexpr JointForms custom_kind(const char* name, std::initializer_list<RowForm> rows) {
  JointForms made = kind(name, rows, Alignment::kFree, {});
  made.has_frames = made.is_custom = true;
  return made;
}

// Kinds in the order of JointKind. The rows x_A·y_B, y_A·z_B, z_A·x_B have eight solutions, all of
// rank 3; misalignment() defines the intended solution.
// clang-format off
constexpr std::array<JointForms, kJointKindCount> kKinds{{
    kind("distance", {{d, d}}, Alignment::kFree, {}),
    kind("ball", {{d, xW}, {d, yW}, {d, zW}}, Alignment::kFree, {}),
    kind("hinge", {{d, xW}, {d, yW}, {d, zW}, {zA, xB}, {zA, yB}}, Alignment::kParallelZ, {angle}),
    kind("slider", {{xA, d}, {yA, d}, {xA, yB}, {yA, zB}, {zA, xB}}, Alignment::kSame, {along_z}),
    kind("cylindrical", {{xA, d}, {yA, d}, {zA, xB}, {zA, yB}}, Alignment::kParallelZ, {along_z, angle}),
    kind("planar", {{zA, d}, {zA, xB}, {zA, yB}}, Alignment::kParallelZ, {along_x, along_y, angle}),
    kind("universal", {{d, xW}, {d, yW}, {d, zW}, {zA, zB}}, Alignment::kPerpendicularZ, {angle_1, angle_2}),
    kind("weld", {{d, xW}, {d, yW}, {d, zW}, {xA, yB}, {yA, zB}, {zA, xB}}, Alignment::kSame, {}),
    kind("point_on_line", {{xA, d}, {yA, d}}, Alignment::kFree, {along_z}),
    kind("point_on_plane", {{zA, d}}, Alignment::kFree, {along_x, along_y}),
    kind("parallel", {{zA, xB}, {zA, yB}}, Alignment::kParallelZ, {angle}),
    kind("free_distance", {}, Alignment::kFree, {length}),
    kind("gear", {}, Alignment::kFree, {}, Couples::kJoints),
    kind("pulley", {}, Alignment::kFree, {}, Couples::kLengths),
    kind("screw", {{xA, d}, {yA, d}, {zA, xB}, {zA, yB}}, Alignment::kParallelZ, {along_z, angle}, Couples::kOwn),
    custom_kind("custom", {{custom, custom}}),
    custom_kind("custom_force", {}),
}};
// clang-format on
static_assert(!kKinds[kOwnJointKindCount - 1].is_custom && kKinds[kOwnJointKindCount].is_custom &&
                  kKinds.back().is_custom,
              "a line for each JointKind");

// Returns the rotation vector along n for an angle in [0, π].
Vector3d vector_of_turn(const Vector3d& n, double sine, double cosine) {
  const double angle_off = math::atan2(sine, cosine);
  return sine > 0.0 ? Vector3d(angle_off / sine * n) : Vector3d(angle_off * Vector3d::UnitX());
}

}  // namespace

const JointForms& forms(JointKind kind) { return kKinds[static_cast<std::size_t>(kind)]; }

const JointKindInfo& info(JointKind kind) { return forms(kind); }

std::optional<JointKind> joint_kind_named(std::string_view text) {
  for (std::size_t i = 0; i < kKinds.size(); ++i)
    if (text == kKinds[i].name) return static_cast<JointKind>(i);
  return std::nullopt;
}

std::string names_of_further_kinds() {
  std::string names;
  for (const JointForms& kind : kKinds)
    if (&kind != &forms(JointKind::kDistance)) names += std::string(", ") + kind.name;
  return names;
}

bool bears_torque(JointKind kind) {
  return forms(kind).has_frames || forms(kind).form == RowsForm::kPoint;
}

const std::array<JointKind, kOwnJointKindCount>& joint_kinds() {
  static const std::array<JointKind, kOwnJointKindCount> kAll = [] {
    std::array<JointKind, kOwnJointKindCount> list{};
    for (std::size_t i = 0; i < list.size(); ++i) list[i] = static_cast<JointKind>(i);
    return list;
  }();
  return kAll;
}

Eigen::Quaterniond frame_along(const Vector3d& axis) {
  check_axis("axis_a", axis);
  const Vector3d n = axis / math::hypot(axis.x(), axis.y(), axis.z());
  if (n.z() < 0.0)  // the opposite axis, turned over by half a turn about x
    return frame_along(-n) * Eigen::Quaterniond(0.0, 1.0, 0.0, 0.0);
  return Eigen::Quaterniond(1.0 + n.z(), -n.y(), n.x(), 0.0).normalized();
}

Eigen::Quaterniond home(Alignment alignment) {
  if (alignment != Alignment::kPerpendicularZ) return Eigen::Quaterniond::Identity();
  // Axes x_B, y_B, z_B along z_A, −y_A, x_A: half a turn about x_A + z_A.
  return {0.0, std::sqrt(0.5), 0.0, std::sqrt(0.5)};
}

Vector3d misalignment(Alignment alignment, const JointVectors& vectors) {
  const Vector3d z = Vector3d::UnitZ();
  const Vector3d a = vectors.axes_B.transpose() * vectors.axes_A.col(2);  // z_A in frame B
  switch (alignment) {
    case Alignment::kFree:
      break;
    case Alignment::kSame:
      return rotation_vector(
          Eigen::Quaterniond(Matrix3d(vectors.axes_B.transpose() * vectors.axes_A)));
    case Alignment::kParallelZ: {
      const Vector3d n = z.cross(a);
      return vector_of_turn(n, n.norm(), a.z());
    }
    case Alignment::kPerpendicularZ: {
      const Vector3d n = a.cross(z);
      const double off = math::atan2(a.z(), n.norm());
      const Vector3d axis = n.norm() > 0.0 ? Vector3d(n.normalized()) : Vector3d(Vector3d::UnitX());
      // A turn of z_B by +off about a × z moves z_B away from a.
      return off * axis;
    }
  }
  return Vector3d::Zero();
}

}  // namespace constraint_sim::engine
