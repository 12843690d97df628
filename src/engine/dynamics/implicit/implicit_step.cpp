#include "engine/dynamics/implicit/implicit_step.h"

#include <algorithm>
#include <cmath>

#include "engine/dynamics/implicit/general_links.h"
#include "engine/dynamics/implicit/point_links.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;
using Kind = ImplicitLink::Kind;

// A row depends on others in this step where its pivot, in the elimination of G M⁻¹ Gᵀ, falls below
// this share of its diagonal entry.
constexpr double kDependentInStep = 1e-10;
// Largest frequency, over the spin, that forces of a rotation itself may make.
constexpr double kCentrifugal = 2.0;

}  // namespace

ImplicitStep::ImplicitStep(const ImplicitStep& other) = default;
ImplicitStep::ImplicitStep(ImplicitStep&& other) noexcept = default;
ImplicitStep& ImplicitStep::operator=(const ImplicitStep& other) = default;
ImplicitStep& ImplicitStep::operator=(ImplicitStep&& other) noexcept = default;
ImplicitStep::~ImplicitStep() = default;

ImplicitStep::ImplicitStep(const EquationsOfMotion& equations)
    : model_(equations),
      motion_(model_, equations.points()),
      system_(model_),
      links_(model_.links().size()),
      softs_(equations.soft_coordinates().size()),
      couplings_(model_),
      squares_(model_.bodies(), 0.0) {}

void ImplicitStep::gather_state(const List<BodyState>& states, const EquationsOfMotion& equations) {
  system_.forget();
  motion_.gather_state(states, equations);
}

void ImplicitStep::forget() {
  std::fill(squares_.begin(), squares_.end(), 0.0);
  frequency_ = 0.0;
}

std::pair<double, double> ImplicitStep::largest_spin(double most_frequency) const {
  double spin = 0.0, speed = 0.0;
  for (std::size_t i = 0; i < model_.rotating(); ++i) {
    // forces of the rotation itself make a frequency of about the spin
    if (frequency_of(i) > std::max(most_frequency, kCentrifugal * motion_.spin(i))) continue;
    spin = std::max(spin, motion_.spin(i));
    speed = std::max(speed, motion_.spin(i) * model_.radius_of_gyration(i));
  }
  return {spin, speed};
}

// ---- start of a step

bool ImplicitStep::begin(double t, double h, ImplicitRule rule, EquationsOfMotion* equations) {
  motion_.predict(model_, {t, h, rule});
  equations->move_with_time(t);
  motion_.place_fixed_points(*equations);
  for (const ImplicitLink& link : model_.links())
    links_[link.index].place(link, model_, motion_, *equations);
  couplings_.unmark_rows();
  if (model_.rows_may_depend() && !leave_out_dependent(t, equations)) return false;

  equations->move_with_time(t + h);
  motion_.set_end(model_, *equations);
  for (const ImplicitLink& link : model_.links())
    links_[link.index].set_target(link, motion_, *equations, &softs_);
  find_sizes(*equations);

  system_.begin(model_, motion_.time());
  for (const ImplicitLink& link : model_.links()) {
    const LinkInStep& state = links_[link.index];
    for (int k = 0; k < link.rows; ++k)
      system_.scale_row(link.unknown + k,
                        link.kind == Kind::kGeneral ? state.row_scale[k] : state.scale);
  }
  couplings_.begin(model_, links_, *equations, &system_);
  return true;
}

// Leaves dependent rows without λ in this step, since their λ is not unique and would drift.
bool ImplicitStep::leave_out_dependent(double t, EquationsOfMotion* equations) {
  if (!equations->find_dependent(t, motion_.positions(), motion_.orientations(), kDependentInStep,
                                 &is_dependent_))
    return false;
  leave_out_momentary_rows(true, *equations);
  return true;
}

void ImplicitStep::leave_out_momentary_rows(bool are_out, const EquationsOfMotion& equations) {
  const auto mark = [&](std::size_t row, bool* is_left_out, bool* is_redundant) {
    *is_redundant = is_dependent_[row] == EquationsOfMotion::kRedundant;
    *is_left_out = *is_redundant || (are_out && is_dependent_[row] != 0);
  };
  for (const ImplicitLink& link : model_.links()) {
    if (link.kind == Kind::kSpring) continue;
    const std::size_t row = equations.row_of(link.index);
    LinkInStep& state = links_[link.index];
    for (std::size_t k = 0; k < to_index(link.rigid_rows); ++k)
      mark(row + k, &state.is_left_out[k], &state.is_redundant[k]);
  }
  couplings_.mark_rows(model_, mark);
}

void ImplicitStep::find_sizes(const EquationsOfMotion& equations) {
  const List<Vector3d>& x = motion_.positions();
  double coordinate = 0.0, spread = 0.0;
  extent_ = model_.extent();
  for (const Vector3d& point : x) {
    coordinate = std::max(coordinate, point.cwiseAbs().maxCoeff());
    spread = std::max(spread, (point - x.front()).cwiseAbs().maxCoeff());
  }
  for (const ImplicitLink& link : model_.links())
    if (link.kind == Kind::kRod || link.kind == Kind::kSpring)
      extent_ = std::max(extent_, equations.inputs().length()[link.index].value);
  scale_ = std::max(coordinate, extent_);
  if (scale_ == 0.0) scale_ = 1.0;  // all points coincide
  extent_ = std::max(extent_, spread);
  if (extent_ == 0.0) extent_ = scale_;
}

// ---- evaluation

void ImplicitStep::evaluate(const Unknowns& unknowns) {
  system_.clear();
  motion_.evaluate(model_, unknowns, &system_);
  for (const ImplicitLink& link : model_.links()) {
    LinkInStep& state = links_[link.index];
    if (link.kind == Kind::kGeneral)
      evaluate_general_link(link, motion_, unknowns, &state, &softs_, &system_);
    else
      evaluate_point_link(link, motion_, unknowns, &state, &system_);
  }
  couplings_.evaluate(model_, motion_, unknowns, &links_, &system_);
  system_.finish(model_);
}

// ---- end of a step

void ImplicitStep::finish(const Unknowns& unknowns, EquationsOfMotion* equations) {
  const double h = motion_.time().h;
  add_impulses(unknowns, equations);
  couplings_.finish(model_, h, unknowns, equations);
  find_frequencies(unknowns);
  const auto turn = [&](std::size_t body) {
    return Eigen::Map<const Vector3d>(unknowns.data() + model_.first_unknown(body) + 3);
  };
  equations->coordinates().add_turns(
      *equations, equations->inputs(), motion_.time().t + h, h, turn,
      [&](std::size_t l, std::size_t end) { return links_[l].axes0[end].col(2); });
  motion_.finish(model_, unknowns);
}

// λ of a rod or spring.
double ImplicitStep::force_of(const ImplicitLink& link, const Unknowns& unknowns) const {
  return links_[link.index].is_in(0) ? unknowns[link.unknown] : 0.0;
}

void ImplicitStep::add_impulses(const Unknowns& unknowns, EquationsOfMotion* equations) const {
  const double h = motion_.time().h;
  for (const ImplicitLink& link : model_.links()) {
    const LinkInStep& state = links_[link.index];
    RowVector impulse = RowVector::Zero();
    switch (link.kind) {
      case Kind::kRod:
        impulse[0] = h * force_of(link, unknowns) * std::sqrt(2.0 * std::max(state.target, 0.0));
        break;
      case Kind::kBall:
        impulse.head<3>() = h * state.force;
        break;
      case Kind::kGeneral:
        for (int k = 0; k < link.rigid_rows; ++k)
          if (state.is_in(k)) impulse[k] = h * unknowns[link.unknown + k];
        for (int k = link.rigid_rows; k < link.rows; ++k) {
          equations->forces().add_soft(*equations, link.soft_of(k), h * unknowns[link.unknown + k]);
          equations->coordinates().set_soft(link.soft_of(k), softs_[link.soft_of(k)].end);
        }
        break;
      case Kind::kSpring:
        impulse[0] = h * force_of(link, unknowns);
        break;
    }
    equations->forces().add(*equations, link.index, impulse);
  }
}

// Estimates ω² of each body from the transverse stiffness of its links under their forces.
void ImplicitStep::find_frequencies(const Unknowns& unknowns) {
  std::fill(squares_.begin(), squares_.end(), 0.0);
  for (const ImplicitLink& link : model_.links()) {
    const LinkInStep& state = links_[link.index];
    double stiffness = 0.0;
    if (link.kind == Kind::kRod) stiffness = std::abs(force_of(link, unknowns));
    if (link.kind == Kind::kSpring)
      stiffness =
          std::abs(force_of(link, unknowns)) / std::max(state.d.norm(), kCoincidentPoints * scale_);
    for (std::size_t e = 0; e < 2; ++e) {
      const ImplicitEnd& end = link.ends[e];
      if (end.dofs == 0) continue;
      double& square = squares_[end.point];
      if (link.kind != Kind::kGeneral) square += 2.0 * stiffness / model_.mass(end.point);
      if (end.dofs < 6) continue;
      const double torque =
          link.kind == Kind::kGeneral ? state.swing[e] : state.force.norm() * state.r0[e].norm();
      square += torque / model_.inertia(end.point).minCoeff();
    }
  }
  frequency_ = std::sqrt(*std::max_element(squares_.begin(), squares_.end()));
}

}  // namespace constraint_sim::engine
