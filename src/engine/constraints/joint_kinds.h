#pragma once

#include <array>

#include "constraint_sim/engine/joint.h"
#include "engine/constraints/forms.h"
#include "engine/model/joint_data.h"

namespace constraint_sim::engine {

// Table of joint kinds. Code that compiles, solves, draws, saves or tests joints reads this table.

/// Condition on the orientations of both frames.
enum class Alignment : std::uint8_t {
  kFree,           ///< no condition
  kSame,           ///< all axes parallel
  kParallelZ,      ///< z_B along z_A
  kPerpendicularZ  ///< z_B at a right angle to z_A
};

/// Pattern of the rows, for methods with a shortcut for some patterns.
enum class RowsForm : std::uint8_t {
  kDistance,  ///< ½ d·d as the only row
  kPoint,     ///< d along the three axes of the world
  kGeneral,
};

/// Entry of the table: the properties of a kind, with its rows and coordinates as functions of the
/// joint's vectors.
struct JointForms : JointKindInfo {
  int rows = 0;  ///< number of entries of `row`; rows with d come first
  std::array<RowForm, kMaxJointRows> row{};
  int separation_rows = 0;  ///< number of rows with d
  RowsForm form = RowsForm::kGeneral;
  Alignment alignment = Alignment::kFree;
  std::array<ScalarForm, kMaxCoordinates> coordinate{};
  std::array<ScalarForm, kMaxJointRows> function{};  ///< rows, then coordinates
};

/// Returns the entry of a kind. kDistance has one row ½(d·d − ℓ²), which its settings may replace;
/// its length has laws of its own.
const JointForms& forms(JointKind kind);

/// Whether a joint of the kind closes by moving the frame on B to its home. Rows of other kinds are
/// closed by decreasing errors, since they act along vectors fixed in A. A point on a body B that
/// cannot turn is closed by decreasing errors too.
constexpr bool closes_by_frame(const JointForms& kind) {
  return kind.alignment != Alignment::kFree || kind.form == RowsForm::kPoint;
}

/// Whether rows depend on the orientation of B, so that B turns even with its anchor at its centre.
constexpr bool turns_b(const JointForms& kind) {
  return kind.alignment != Alignment::kFree || kind.is_custom;
}

/// Whether the row of the kind is a length, with laws of its own.
constexpr bool has_length(JointKind kind) { return kind == JointKind::kDistance; }

/// Whether the kind has no rows but a force of another package.
constexpr bool is_custom_force(JointKind kind) { return kind == JointKind::kCustomForce; }

/// Whether joints of the kind exert a torque about their anchor, which break_torque bounds.
bool bears_torque(JointKind kind);

/// Kind that replaces a rod of length zero.
inline constexpr JointKind kKindOfLengthZero = JointKind::kBall;

/// Returns the orientation of an aligned frame B in frame A: the identity, except for
/// kPerpendicularZ.
Eigen::Quaterniond home(Alignment alignment);

/// Returns the rotation vector ϑ, in the joint's frame on B [rad], that aligns B. It is correct for
/// any angle, while rows have several solutions.
Eigen::Vector3d misalignment(Alignment alignment, const JointVectors& vectors);

}  // namespace constraint_sim::engine
