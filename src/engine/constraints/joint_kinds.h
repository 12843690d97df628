#pragma once

#include <array>

#include "engine/constraints/forms.h"

namespace constraint_sim::engine {

// The table of joint kinds. Whoever compiles, solves, draws, saves or tests a joint asks the table.

/// What has to be so between the orientations of both frames.
enum class Alignment : std::uint8_t {
  kFree,           ///< nothing
  kSame,           ///< all axes
  kParallelZ,      ///< z_B along z_A
  kPerpendicularZ  ///< z_B at a right angle to z_A
};

/// What rows there are, for methods that have a shorter way for some.
enum class RowsForm : std::uint8_t {
  kDistance,  ///< ½ d·d alone
  kPoint,     ///< d along the three axes of the world
  kGeneral,
};

/// Which coordinates a joint couples, in one row.
enum class Couples : std::uint8_t {
  kNothing,
  kJoints,   ///< the first ones of two other joints
  kLengths,  ///< the same of joints whose coordinate is a length
  kOwn,      ///< its own two, by a pitch
};

struct JointKindInfo {
  const char* name = "";  ///< as in scene files
  int rows = 0;           ///< of the next, first those with d
  std::array<RowForm, kMaxJointRows> row{};
  int separation_rows = 0;  ///< so many of them have d
  RowsForm form = RowsForm::kGeneral;
  Alignment alignment = Alignment::kFree;
  Couples couples = Couples::kNothing;
  bool has_frames = false;                               ///< whether any row has an axis of A or B
  bool is_custom = false;                                ///< by functions of another package
  int coordinates = 0;                                   ///< that are free and can have laws
  std::array<ScalarForm, kMaxCoordinates> coordinate{};  ///< those
  std::array<ScalarForm, kMaxJointRows> function{};      ///< rows first, then coordinates
};

/// Of kDistance: one row ½(d·d − ℓ²), or what its settings make of it; its length has laws of its
/// own.
const JointKindInfo& info(JointKind kind);

/// Whether the frame on B may go home while a joint of the kind is closed. Rows of others are off
/// by less and less instead: they act along what goes with A. So do those of a point on a B that
/// cannot turn.
constexpr bool closes_by_frame(const JointKindInfo& kind) {
  return kind.alignment != Alignment::kFree || kind.form == RowsForm::kPoint;
}

/// Whether the orientation of B counts, so that B turns also where its anchor is its centre.
constexpr bool turns_b(const JointKindInfo& kind) {
  return kind.alignment != Alignment::kFree || kind.is_custom;
}

/// Whether its row is a length, with laws of its own.
constexpr bool has_length(JointKind kind) { return kind == JointKind::kDistance; }

/// Whether it has no rows but a force of another package.
constexpr bool is_custom_force(JointKind kind) { return kind == JointKind::kCustomForce; }

/// What a rod of length zero is.
inline constexpr JointKind kKindOfLengthZero = JointKind::kBall;

/// Frame B where it has to be, as seen from frame A: the identity, but of kPerpendicularZ.
Eigen::Quaterniond home(Alignment alignment);

/// The rotation vector ϑ, in the joint's frame on B [rad], by which B has to turn to be aligned. It
/// is right at any angle, where rows have several solutions.
Eigen::Vector3d misalignment(Alignment alignment, const JointVectors& vectors);

}  // namespace constraint_sim::engine
