#include "engine/dynamics/implicit_step.h"

#include <algorithm>
#include <cmath>
#include <queue>
#include <utility>

#include "engine/math/cross_matrix.h"
#include "engine/math/larger.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Block = Eigen::Matrix<double, 6, 3>;
using ConstVector = Eigen::Map<const Vector3d>;
using Vector = Eigen::Map<Vector3d>;

// A row depends on others in this step where its pivot falls below this share of its diagonal
// entry.
constexpr double kDependentPivot = 1e-10;

}  // namespace

// ---- state at the start of the step

ImplicitStep::ImplicitStep(const ImplicitStep& other) = default;
ImplicitStep::ImplicitStep(ImplicitStep&& other) noexcept = default;
ImplicitStep& ImplicitStep::operator=(const ImplicitStep& other) = default;
ImplicitStep& ImplicitStep::operator=(ImplicitStep&& other) noexcept = default;
ImplicitStep::~ImplicitStep() = default;

void ImplicitStep::gather_state(const List<BodyState>& states, const EquationsOfMotion& equations) {
  lu_.forget();
  for (std::size_t i = 0; i < bodies_; ++i) {
    const BodyState& state = states[equations.bodies()[i]];
    x_[i] = state.position;
    v_[i] = state.linear_velocity;
    if (i >= rotating_) continue;
    q_[i] = state.orientation;
    angular_velocity_[i] = state.angular_velocity;
  }
}

void ImplicitStep::scatter_state(const EquationsOfMotion& equations,
                                 List<BodyState>* states) const {
  for (std::size_t i = 0; i < bodies_; ++i) {
    BodyState& state = (*states)[equations.bodies()[i]];
    state.position = x_[i];
    state.linear_velocity = v_[i];
    if (i >= rotating_) continue;
    state.orientation = q_[i];
    state.angular_velocity = angular_velocity_[i];
  }
}

void ImplicitStep::write_points(Points* points) const {
  points->position.assign(x_.begin(), x_.begin() + static_cast<std::ptrdiff_t>(bodies_));
  points->velocity.assign(v_.begin(), v_.begin() + static_cast<std::ptrdiff_t>(bodies_));
  for (std::size_t i = 0; i < rotating_; ++i) {
    const Matrix3d arms = radius_[i] * q_[i].toRotationMatrix();
    for (int k = 0; k < 3; ++k) {
      points->position.push_back(x_[i] + arms.col(k));
      points->velocity.push_back(v_[i] + angular_velocity_[i].cross(arms.col(k)));
    }
  }
}

void ImplicitStep::forget() {
  std::fill(squares_.begin(), squares_.end(), 0.0);
  frequency_ = 0.0;
}

// ---- one step

void ImplicitStep::set_rule(double h, ImplicitRule rule) {
  rule_ = rule;
  h_ = h;
  switch (rule) {
    case ImplicitRule::kMidpoint:
      s_ = 0.5 * h * h;
      share_ = 0.5;
      break;
    case ImplicitRule::kBdf2:
      s_ = 4.0 / 9.0 * h * h;
      share_ = 1.0;
      break;
  }
}

// Predicts the displacement p and rotation a of a step without forces, and the momentum b.
void ImplicitStep::predict() {
  const double h = h_;
  for (std::size_t i = 0; i < bodies_; ++i) {
    p_[i] = h * v_[i];
    if (rule_ == ImplicitRule::kBdf2)
      p_[i] = dx_before_[i] / 3.0 + h / 9.0 * (8.0 * v_[i] - 2.0 * v_before_[i]);
    v_before_[i] = v_[i];
  }
  for (std::size_t i = 0; i < rotating_; ++i) {
    Turning& turn = J_angular_[i];
    turn.R0 = q_[i].toRotationMatrix();
    turn.J0 = turn.R0 * inertia_[i].asDiagonal() * turn.R0.transpose();
    const Vector3d L = turn.J0 * angular_velocity_[i];
    switch (rule_) {
      case ImplicitRule::kMidpoint:
        turn.a = 0.5 * h * angular_velocity_[i];
        turn.b = 0.5 * h * L;
        break;
      case ImplicitRule::kBdf2:
        turn.a = w_before_[i] / 3.0;
        turn.b = h / 9.0 * (8.0 * L - 2.0 * L_before_[i]);
        break;
    }
    L_before_[i] = L;
  }
}

bool ImplicitStep::begin(double t, double h, ImplicitRule rule, EquationsOfMotion* equations) {
  t_ = t;
  set_rule(h, rule);
  predict();
  equations->move_with_time(t);
  for (std::size_t p = bodies_; p < x_.size(); ++p) x_[p] = equations->kinematics().position()[p];
  double coordinate = 0.0, spread = 0.0;
  extent_ = 0.0;
  for (const Vector3d& x : x_) {
    coordinate = std::max(coordinate, x.cwiseAbs().maxCoeff());
    spread = std::max(spread, (x - x_.front()).cwiseAbs().maxCoeff());
  }
  for (std::size_t l = 0; l < links_.size(); ++l) place_link(l, *equations);
  for (CoupledRow& coupled : coupled_) coupled.is_left_out = coupled.is_redundant = false;
  if (may_depend_ && !leave_out_dependent(t, equations)) return false;

  equations->move_with_time(t + h);
  for (std::size_t p = bodies_; p < x_.size(); ++p)
    shift_[p] = equations->kinematics().position()[p] - x_[p];
  for (std::size_t l = 0; l < links_.size(); ++l) ask_link(l, *equations);
  scale_ = std::max(coordinate, extent_);
  if (scale_ == 0.0) scale_ = 1.0;  // all points coincide
  extent_ = std::max(extent_, spread);
  if (extent_ == 0.0) extent_ = scale_;
  scale_equations(*equations);
  if (!coupled_.empty()) begin_coupled(*equations);
  return true;
}

// Sets the geometry of a link at the start of the step.
void ImplicitStep::place_link(std::size_t l, const EquationsOfMotion& equations) {
  const Link& link = links_[l];
  Shape& shape = shapes_[l];
  shape.custom = link.custom;
  shape.d0 = x_[link.ends[1].point] - x_[link.ends[0].point];
  for (std::size_t e = 0; e < 2; ++e) {
    const End& end = link.ends[e];
    shape.r0[e].setZero();
    if (end.dofs < 6) continue;
    const bool is_frame = e == 1 && link.kind == Kind::kGeneral;
    shape.r0[e] =
        J_angular_[end.point].R0 * (is_frame ? equations.inputs().frame_b(l).anchor : end.anchor);
    shape.d0 += end.sign * shape.r0[e];
    extent_ = std::max(extent_, end.anchor.norm());
  }
  // Part of the spring's law at the start; ask_spring() adds the rest.
  if (link.kind == Kind::kSpring) shape.target = equations.inputs().length()[l].value;
  // Inverse of the displacement by 1 N, or of a rod by λ = 1.
  double compliance = 0.0;
  for (std::size_t e = 0; e < 2; ++e) {
    const End& end = link.ends[e];
    if (end.dofs == 0) continue;
    compliance += 1.0 / mass_[end.point];
    if (end.dofs == 6) compliance += shape.r0[e].squaredNorm() / inertia_[end.point].mean();
  }
  shape.scale = 1.0 / std::sqrt(compliance);
  if (link.kind == Kind::kGeneral) {
    place_axes(equations, link, &shape.axes0);
    begin_general(link, &shape);
    extent_ = std::max(extent_, link.radius);
  }
  if (link.kind == Kind::kRod) shape.scale /= shape.d0.norm();
  shape.is_left_out = shape.is_redundant = {};
}

// Sets the target of a link at the end of the step.
void ImplicitStep::ask_link(std::size_t l, const EquationsOfMotion& equations) {
  const Link& link = links_[l];
  Shape& shape = shapes_[l];
  if (link.kind == Kind::kGeneral) {
    place_axes(equations, link, &shape.axes1);
    shape.next_axes_B = shape.axes1[1];
    const End& b = link.ends[1];
    shape.next_r_B = shape.r0[1];
    if (b.dofs == 6) shape.next_r_B = J_angular_[b.point].R0 * equations.inputs().frame_b(l).anchor;
  }
  if (link.has_custom_force) ask_custom_force(link, equations, &shape);
  if (link.kind == Kind::kBall || link.kind == Kind::kGeneral) {
    shape.offset = equations.inputs().offset(equations, l);
    if (link.rows > link.rigid_rows) begin_softs(link, shape, equations);
    return;
  }
  const Prescribed& length = equations.inputs().length()[l];
  extent_ = std::max(extent_, length.value);
  if (link.kind == Kind::kRod) {
    shape.target = 0.5 * length.value * length.value;
    return;
  }
  ask_spring(link, length, &shape);
}

// Sets target and compliance of a spring, whose law is divided by its factor of s₁:
//   midpoint: σ = −k (½(s₀ + s₁) − ½(ℓ₀ + ℓ₁)) − (c/h)(s₁ − s₀ − (ℓ₁ − ℓ₀))
//   BDF2:     σ = −k (s₁ − ℓ₁) − (c/2h)(3 s₁ − 4 s₀ + s₋) + c ℓ̇₁
void ImplicitStep::ask_spring(const Link& link, const Prescribed& length, Shape* shape) const {
  const double k = link.stiffness;
  const double rate = link.damping / h_;
  const double s0 = shape->d0.norm();
  switch (rule_) {
    case ImplicitRule::kMidpoint:
      shape->compliance = 1.0 / (0.5 * k + rate);
      shape->target = length.value - shape->compliance * (0.5 * k - rate) * (s0 - shape->target);
      break;
    case ImplicitRule::kBdf2:
      shape->compliance = 1.0 / (k + 1.5 * rate);
      shape->target = shape->compliance * (k * length.value + link.damping * length.rate +
                                           rate * (2.0 * s0 - 0.5 * shape->before));
      break;
  }
  shape->before = s0;
  shape->scale =
      1.0 / std::sqrt(1.0 / (shape->scale * shape->scale) + std::abs(shape->compliance) / s_);
}

void ImplicitStep::scale_equations(const EquationsOfMotion& equations) {
  for (std::size_t i = 0; i < bodies_; ++i) {
    force_[i] = mass_[i] * equations.inputs().acceleration()[i];
    const auto first = to_index(first_unknown_[i]);
    const double scale = 1.0 / std::sqrt(mass_[i]);
    std::fill_n(left_.begin() + static_cast<std::ptrdiff_t>(first), 3, scale);
    std::fill_n(right_.begin() + static_cast<std::ptrdiff_t>(first), 3, scale);
    if (i >= rotating_) continue;
    torque_[i] = equations.inputs().torque()[i];
    const double turning = 1.0 / std::sqrt(inertia_[i].mean());
    std::fill_n(left_.begin() + static_cast<std::ptrdiff_t>(first) + 3, 3, turning);
    std::fill_n(right_.begin() + static_cast<std::ptrdiff_t>(first) + 3, 3, turning);
  }
  for (std::size_t l = 0; l < links_.size(); ++l) {
    for (int k = 0; k < links_[l].rows; ++k) {
      const double scale =
          links_[l].kind == Kind::kGeneral ? shapes_[l].row_scale[k] : shapes_[l].scale;
      left_[links_[l].unknown + k] = scale;
      right_[links_[l].unknown + k] = scale / s_;
    }
  }
}

// Leaves dependent rows without λ in this step, since their λ is not unique and would drift.
bool ImplicitStep::leave_out_dependent(double t, EquationsOfMotion* equations) {
  if (!equations->find_dependent(t, x_, q_, kDependentPivot, &is_dependent_)) return false;
  leave_out_momentary_rows(true, *equations);
  return true;
}

void ImplicitStep::leave_out_momentary_rows(bool are_out, const EquationsOfMotion& equations) {
  const auto mark = [&](std::size_t row, bool* is_left_out, bool* is_redundant) {
    *is_redundant = is_dependent_[row] == EquationsOfMotion::kRedundant;
    *is_left_out = *is_redundant || (are_out && is_dependent_[row] != 0);
  };
  for (std::size_t l = 0; l < links_.size(); ++l) {
    if (links_[l].kind == Kind::kSpring) continue;
    const std::size_t row = equations.row_of(l);
    for (std::size_t k = 0; k < to_index(links_[l].rigid_rows); ++k)
      mark(row + k, &shapes_[l].is_left_out[k], &shapes_[l].is_redundant[k]);
  }
  for (CoupledRow& coupled : coupled_)
    mark(coupled.row, &coupled.is_left_out, &coupled.is_redundant);
}

std::pair<double, double> ImplicitStep::largest_spin(double most_frequency) const {
  double spin = 0.0, speed = 0.0;
  for (std::size_t i = 0; i < rotating_; ++i) {
    if (frequency_of(i) > most_frequency) continue;
    spin = std::max(spin, angular_velocity_[i].norm());
    speed = std::max(speed, angular_velocity_[i].norm() * radius_[i]);
  }
  return {spin, speed};
}

double ImplicitStep::add(const double* change, Unknowns* unknowns) const {
  double largest = 0.0;
  const auto consider = [&](double square) { largest = larger(largest, square); };
  for (std::size_t u = 0; u < unknowns->size(); ++u) (*unknowns)[u] += right_[u] * change[u];
  for (std::size_t i = 0; i < bodies_; ++i) {
    const auto first = to_index(first_unknown_[i]);
    consider(right_[first] * right_[first] * ConstVector(change + first).squaredNorm());
    if (i >= rotating_) continue;
    const double scale = right_[first + 3] * radius_[i];
    consider(scale * scale * ConstVector(change + first + 3).squaredNorm());
  }
  return std::sqrt(largest);
}

void ImplicitStep::finish(const Unknowns& unknowns, EquationsOfMotion* equations) {
  std::fill(squares_.begin(), squares_.end(), 0.0);
  for (std::size_t l = 0; l < links_.size(); ++l) {
    const Link& link = links_[l];
    const Shape& shape = shapes_[l];
    const double length = std::sqrt(2.0 * std::max(shape.target, 0.0));
    const bool has_row = to_index(link.unknown) < unknowns.size();  // a custom force has no row
    const double lambda = !has_row || shape.is_left_out[0] ? 0.0 : unknowns[link.unknown];
    double stiffness = 0.0;  // transverse stiffness of the link
    RowVector impulse = RowVector::Zero();
    switch (link.kind) {
      case Kind::kRod:
        equations->forces().add(*equations, l, h_ * lambda * length * RowVector::Unit(0));
        stiffness = std::abs(lambda);
        break;
      case Kind::kBall:
        impulse.head<3>() = h_ * shape.force;
        equations->forces().add(*equations, l, impulse);
        break;
      case Kind::kGeneral:
        for (int k = 0; k < link.rigid_rows; ++k)
          if (!shape.is_left_out[k]) impulse[k] = h_ * unknowns[link.unknown + k];
        equations->forces().add(*equations, l, impulse);
        for (int k = link.rigid_rows; k < link.rows; ++k) {
          const std::size_t s = link.first_soft + to_index(k - link.rigid_rows);
          equations->forces().add_soft(*equations, s, h_ * unknowns[link.unknown + k]);
          equations->coordinates().set_soft(s, softs_[s].end);
        }
        for (std::size_t e = 0; e < 2; ++e)
          if (link.ends[e].dofs == 6)
            squares_[link.ends[e].point] +=
                shape.swing[e] / inertia_[link.ends[e].point].minCoeff();
        continue;
      case Kind::kSpring:
        equations->forces().add(*equations, l, h_ * lambda * RowVector::Unit(0));
        stiffness = std::abs(lambda) / std::max(shape.d.norm(), 1e-9 * scale_);
        break;
    }
    for (std::size_t e = 0; e < 2; ++e) {
      const End& end = link.ends[e];
      if (end.dofs == 0) continue;
      squares_[end.point] += 2.0 * stiffness / mass_[end.point];
      if (end.dofs == 6)
        squares_[end.point] +=
            shape.force.norm() * shape.r0[e].norm() / inertia_[end.point].minCoeff();
    }
  }
  for (std::size_t c = 0; c < coupled_.size(); ++c) {
    const CoupledRow& coupled = coupled_[c];
    if (!coupled.is_left_out)
      equations->forces().add_coupled(*equations, c, h_ * unknowns[coupled.unknown]);
    for (std::size_t k = 0; k < 2; ++k)
      equations->coordinates().set_term(c, k, coupled.terms[k].end);
  }
  frequency_ = std::sqrt(*std::max_element(squares_.begin(), squares_.end()));
  const auto turn = [&](std::size_t body) {
    return ConstVector(unknowns.data() + to_index(first_unknown_[body]) + 3);
  };
  equations->coordinates().add_turns(
      *equations, equations->inputs(), t_ + h_, h_, turn,
      [&](std::size_t l, std::size_t end) { return shapes_[l].axes0[end].col(2); });

  // Velocity at the end from the change (Δx or w), the change of the previous step, and the
  // velocity at the start.
  const auto rate = [&](const Vector3d& change, const Vector3d& before, const Vector3d& velocity) {
    if (rule_ == ImplicitRule::kMidpoint) return Vector3d(2.0 / h_ * change - velocity);
    return Vector3d((1.5 * change - 0.5 * before) / h_);
  };
  for (std::size_t i = 0; i < bodies_; ++i) {
    const auto first = to_index(first_unknown_[i]);
    const ConstVector dx(unknowns.data() + first);
    x_[i] += dx;
    v_[i] = rate(dx, dx_before_[i], v_[i]);
    dx_before_[i] = dx;
    if (i >= rotating_) continue;
    const ConstVector w(unknowns.data() + first + 3);
    const Vector3d spin = rate(w, w_before_[i], angular_velocity_[i]);
    w_before_[i] = w;
    angular_velocity_[i] = spin + w.cross(mean_rotation(w) * spin);
    const Vector3d half = 0.5 * w;
    const Eigen::Quaterniond turn(1.0, half.x(), half.y(), half.z());
    q_[i] = (turn * q_[i]).normalized();
  }
}

}  // namespace constraint_sim::engine
