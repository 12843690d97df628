#pragma once

#include <utility>

#include "constraint_sim/engine/body.h"
#include "constraint_sim/engine/shape.h"
#include "engine/collision/broadphase.h"
#include "engine/collision/contact_tolerances.h"
#include "engine/collision/narrowphase.h"
#include "engine/model/model.h"
#include "engine/model/shape_pair.h"
#include "engine/model/state.h"

namespace constraint_sim::engine {

struct StepContext;

// How far bodies can get within a time, and how far apart they are.

/// Whether a body has a shape that may touch other shapes.
bool may_touch(const Body& body);
/// Whether the settings of two bodies let them collide, whatever their shapes and joints.
bool may_collide(const Body& a, const Body& b);
/// Whether the groups of a body let it collide with every other body with this property.
bool collides_with_all(const Body& body);

/// Least width of a shape, or of the thinnest part of a compound [m]; infinite of planes, which are
/// half-spaces, and of points.
double thickness(const Shape& shape);
/// The smaller thickness of two shapes [m].
double thinner_of(const Model& model, const ShapePair& pair);

/// Tolerances of contacts between two shapes.
ContactTolerances tolerances_of(const Model& model, const State& state, const ShapePair& pair);

/// Share of the smaller thickness up to which contacts with a gap are sought: larger margins than a
/// tenth of the smallest half edge would miss features of boxes.
inline constexpr double kMarginShare = 0.05;
/// Largest displacement of two bodies in a step that is not fast, as a share of the smaller
/// thickness. Where errors of contacts are controlled, no gap is left out that bodies close by
/// their velocities and gravity; forces may close it.
double fast_share(const WorldOptions& options);

/// Radius about the centre of a body within which its rotation moves its shape [m]; 0 for a centred
/// sphere. For a plane, the `distance` at which another shape meets it.
double swing_radius(const Body& body, double distance = 0.0);

/// Whether the shape of a body is centred in its centre of mass, without a pose of its own.
bool is_centred(const Body& body);

/// Radius around the centre of a body that holds its shape [m]; infinite of planes.
double extent(const Body& body);

/// Largest displacement of the centre of a body in a state within a duration [s], by velocity and
/// gravity, and by the path that the step assumes [m].
double max_center_displacement(const StepContext& step, const BodyState& now, int body,
                               double duration);
/// Largest displacement of a point of a body [m].
double max_point_displacement(const StepContext& step, const BodyState& now, int body,
                              double duration);
/// Margin by which the bounds of a body hold the body throughout a duration, whatever it bounces
/// off [m]: however fast the body turns, its shape stays within the swing radius.
double max_distance(const StepContext& step, const BodyState& now, int body, double duration);

/// Adds the shapes of a body at a pose for the broadphase, with boxes that are widened by a margin
/// on all sides [m].
void add_proxies(const Model& model, const BodyState& at, int body, double margin,
                 List<Proxy>* proxies);

/// Whether two bodies move against each other by more than fast_share() of the thinner shape.
bool is_fast(const StepContext& step, const State& state, const ShapePair& pair, double duration);

/// Returns how far a body moves within a duration, with the fall from rest in that time [m].
double displacement_with_fall(const WorldOptions& options, const BodyState& body, double duration);
/// Returns the gap within which contacts of a pair are rows of impulses for a duration [m].
double contact_margin(const StepContext& step, const State& state, const ShapePair& pair,
                      double duration);

/// Returns the contact of two shapes, with points up to a gap [m].
Manifold collide(const Model& model, const State& state, const ShapePair& pair, double margin);
/// Returns the separation of two shapes, with their bodies in the given states.
Separation separation_of(const Model& model, const ShapePair& pair, const BodyState& first,
                         const BodyState& second);
/// Returns the separation of two shapes.
Separation separation_of(const Model& model, const State& state, const ShapePair& pair);

}  // namespace constraint_sim::engine
