#pragma once

// Grades of a motion without knowledge of the right one: conserved quantities, joints, limits and
// overlaps, each relative to the scene's own scale; and a reference where there is one.

#include <string>

#include "contestant.h"
#include "measures.h"

namespace constraint_sim::report {

/// Share of a scale up to which a quantity counts as held: a line's width in a picture. Beyond the
/// whole scale a motion has nothing in common with the scene.
inline constexpr double kHeldShare = 0.01;

enum class Grade { kHeld, kInaccurate, kBlewUp };
const char* name(Grade grade);

/// Quantities that are judged, in the order in which ties are named.
enum class Criterion {
  kFinite,       ///< all numbers are finite
  kJoint,        ///< errors of joints and ropes over the scene's length
  kLimit,        ///< excess over limits of coordinates, in radians or over the scene's length
  kPenetration,  ///< overlap over half the edge or radius of the smallest shape
  kEnergy,       ///< rise of energy, without contacts and laws any change, over its scale
  kMomentum,     ///< change of the momenta of isolated scenes over their scales
  kReference  ///< distance from the reference over length or path, or angle [rad]; never blows up
};
const char* name(Criterion criterion);

/// Whether the engine told of an error.
enum class Word {
  kSilent,
  kGrown,  ///< its estimate explains the error with the growth of disturbances, not alone
  kSaid    ///< by a warning, or by an error figure of this order
};
const char* name(Word word);

struct Judgement {
  Grade grade = Grade::kHeld;
  Criterion worst = Criterion::kFinite;  ///< criterion with the largest amount
  double amount = 0.0;                   ///< relative, as at Criterion
  double time = 0.0;    ///< at which the amount was found, or the scale exceeded first [s]
  double growth = 1.0;  ///< growth of a disturbance until the amount; 1 without a reference
  Word word = Word::kSilent;
  std::string said;  ///< the words or figure, else all figures
};

/// A reference, which may end before the motion or be empty, and its motion from a disturbed start.
struct Reference {
  Trajectory exact;
  Trajectory disturbed;  ///< by disturbed(); may be shorter
};
/// Velocity added to bodies by disturbed(), over the speed of the scene, and the share of its
/// length that a disturbance counts as.
inline constexpr double kDisturbance = 1e-9;
/// Returns the problem with other initial velocities, to learn how a motion amplifies errors.
Problem disturbed(const Problem& problem);

/// Judges a motion. `is_finite` is false where the motion ends with a state that is not finite and
/// was left out.
Judgement judge(const Problem& problem, const Motion& motion, bool is_finite, const Said& said,
                const Reference& reference);

/// Returns the number of leading samples in which two motions agree, to be trusted as a reference.
std::size_t agreement(const Problem& problem, const Trajectory& a, const Trajectory& b);

/// Returns the scale of a scene's speeds [m/s]: of a fall over its length, of its length in a
/// second and of its start.
double speed_of(const Problem& problem);

/// Describes a scene in a line: bodies, joints, and its extremes.
std::string description(const Problem& problem);

}  // namespace constraint_sim::report
