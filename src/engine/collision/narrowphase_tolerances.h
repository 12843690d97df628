#pragma once

namespace constraint_sim::engine {

// Tolerances that several pairs of shapes share. A share has no unit; it multiplies a length [m]:
// the extents of both shapes for axes, and of the smaller shape or of the clipped feature for
// clipping.

// ---- choice of the axis

/// Share of the size by which the depth along a later axis must be less. Depths along equivalent
/// axes differ by rounding, some 1e-15 of the size, and a tie must not switch from step to step.
inline constexpr double kTieShare = 1e-10;
/// Sine of two directions below which the direction of their cross product is rounding; also the
/// share of a size below which the direction of a difference of points is rounding. Rounding of
/// 1e-16 turns a direction by 1e-8 there.
inline constexpr double kParallelSine = 1e-8;
/// Share of the size below which the direction between nearest points is rounding, and shapes count
/// as touching: the axis of least depth serves. Rounding of 1e-16 of the size turns the direction
/// by 1e-9 there.
inline constexpr double kTouchingShare = 1e-7;
/// Difference of an angle [rad], or of the tangent of half an angle, below which a search for an
/// axis ends: some units in the last place.
inline constexpr double kAngleRounding = 1e-15;
/// Bisections of an interval of order 1 that reach rounding: 2⁻⁶⁰ is 1e-18.
inline constexpr int kMostBisections = 60;

// ---- choice of the face

/// Cosine of the angle (2.56°) between axis and face normal, from which on a face is taken: several
/// points of an area hold a shape more firmly than a single point.
inline constexpr double kFaceCosine = 0.999;
/// Sine of the angle (2.56°) between contact normal and face normal, up to which a face touches
/// with its area; rounded from kFaceCosine.
inline constexpr double kFlatSine = 0.0447;
/// Difference of the cosines between the axis and the nearest face of each shape, up to which both
/// faces count as parallel: the face of A is taken, so that rounding cannot switch faces.
inline constexpr double kBothParallel = 1e-6;
/// Share of a cosine by which a later face must be nearer to the axis: where both are parallel, the
/// first face is taken whatever the rounding.
inline constexpr double kLaterFaceShare = 1e-9;
/// Share of the margin by which a single nearest point must be closer than the points of a face or
/// edge, so that shapes about to rest keep several points.
inline constexpr double kCloserShare = 0.01;

// ---- clipping

/// Share of the size by which clipping faces, caps and lines are widened, so that points on a flush
/// border stay, and keep their features under rounding.
inline constexpr double kWiderShare = 1e-6;
/// Sine of the tilt of a cap below which it counts as level: its points lie along the body's axes,
/// since the direction to its lowest point would change from step to step as a cap settles.
inline constexpr double kLevelSine = 1e-4;

}  // namespace constraint_sim::engine
