#include "engine/methods/implicit_step.h"

#include <algorithm>
#include <cmath>
#include <queue>
#include <utility>

#include "engine/methods/cross_matrix.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Block = Eigen::Matrix<double, 6, 3>;
using ConstVector = Eigen::Map<const Vector3d>;
using Vector = Eigen::Map<Vector3d>;

// Rows whose pivot falls below this share of its entry follow from others in this step.
constexpr double kDependentPivot = 1e-10;

std::size_t at(int i) { return static_cast<std::size_t>(i); }

// (1 − ½ŵ)⁻¹
Matrix3d mean_rotation(const Vector3d& w) {
  const Matrix3d B = Matrix3d::Identity() + 0.5 * cross_matrix(w) + 0.25 * w * w.transpose();
  return B / (1.0 + 0.25 * w.squaredNorm());
}

}  // namespace

// ---- what is compiled

ImplicitStep::ImplicitStep(const EquationsOfMotion& equations)
    : bodies_(equations.bodies().size()), turning_(equations.turning()) {
  for (std::size_t i = 0; i < bodies_; ++i) mass_.push_back(1.0 / equations.inverse_mass(i));
  for (std::size_t i = 0; i < turning_; ++i) {
    inertia_.push_back(equations.inertia(i));
    radius_.push_back(equations.radius_of_gyration(i));
  }
  for (std::size_t l = 0; l < equations.links().size(); ++l) {
    const EquationsOfMotion::Link& from = equations.links()[l];
    Link link;
    link.kind = equations.is_rod(l)       ? Kind::kRod
                : equations.is_ball(l)    ? Kind::kBall
                : equations.is_general(l) ? Kind::kGeneral
                                          : Kind::kSpring;
    link.rigid_rows = static_cast<int>(equations.rows_of(l));
    link.rows = link.rigid_rows + static_cast<int>(from.softs);
    link.function = from.function;
    link.first_soft = from.first_soft;
    for (std::size_t s = 0; s < from.softs; ++s)
      link.function[at(link.rigid_rows) + s] =
          static_cast<std::uint8_t>(equations.soft_coordinates()[from.first_soft + s].function);
    link.joint = from.kind;
    link.frames = {from.frame_a, from.frame_b};
    link.radius = from.radius;
    const auto end = [&](std::size_t point, const Vector3d& anchor, double sign) {
      End e;
      e.point = point;
      e.dofs = point < turning_ ? 6 : (point < bodies_ ? 3 : 0);
      e.anchor = anchor;
      e.sign = sign;
      return e;
    };
    link.ends[0] = end(from.a, from.anchor_a, -1.0);
    link.ends[1] = end(from.b, from.anchor_b, 1.0);
    link.is_between_points =
        link.kind == Kind::kRod && link.ends[0].dofs < 6 && link.ends[1].dofs < 6;
    link.stiffness = from.stiffness;
    link.damping = from.damping;
    has_dampers_ = has_dampers_ || link.damping > 0.0;
    links_.push_back(link);
  }
  if (!equations.coupled_rows().empty()) add_coupled(equations);
  make_nodes(equations);
  find_slots();

  const std::size_t points = equations.points();
  for (auto* list : {&x_, &v_, &shift_}) list->assign(points, Vector3d::Zero());
  for (auto* list : {&force_, &torque_, &p_, &dx_before_, &v_before_, &w_before_, &L_before_})
    list->assign(bodies_, Vector3d::Zero());
  q_.assign(turning_, Eigen::Quaterniond::Identity());
  spin_.assign(turning_, Vector3d::Zero());
  turn_.resize(turning_);
  shapes_.resize(links_.size());
  softs_.resize(equations.soft_coordinates().size());
  for (const EquationsOfMotion::SoftCoordinate& soft : equations.soft_coordinates())
    has_dampers_ = has_dampers_ || soft.law.C > 0.0;
  left_.assign(lu_.size(), 1.0);
  right_ = left_;
  residual_ = left_;
  squares_.assign(bodies_, 0.0);
}

// Bodies as nodes, from the leaves to a root that is held by the world if one is; the rows between
// two bodies belong to the one further from the root.
void ImplicitStep::make_nodes(const EquationsOfMotion& equations) {
  std::vector<std::vector<std::size_t>> links_of(bodies_);
  std::vector<std::size_t> roots;
  for (std::size_t l = 0; l < links_.size(); ++l) {
    const auto& ends = links_[l].ends;
    for (std::size_t e = 0; e < 2; ++e) {
      if (ends[e].dofs == 0) continue;
      links_of[ends[e].point].push_back(l);
      if (ends[1 - e].dofs == 0) roots.push_back(ends[e].point);
    }
  }
  for (std::size_t i = 0; i < bodies_; ++i) roots.push_back(i);

  std::vector<std::size_t> found;  // from a root on
  std::vector<int> parent(bodies_, -1), place(bodies_, -1);
  for (const std::size_t root : roots) {
    if (place[root] >= 0) continue;
    place[root] = static_cast<int>(found.size());
    found.push_back(root);
    for (std::size_t k = at(place[root]); k < found.size(); ++k) {
      for (const std::size_t l : links_of[found[k]]) {
        const auto& ends = links_[l].ends;
        const std::size_t other = ends[0].point == found[k] ? ends[1].point : ends[0].point;
        if (other >= bodies_ || place[other] >= 0) continue;
        place[other] = static_cast<int>(found.size());
        parent[other] = static_cast<int>(found[k]);
        found.push_back(other);
      }
    }
  }

  std::vector<SaddleLu::Node> nodes(bodies_);
  const auto node_of = [&](std::size_t body) {
    return static_cast<int>(bodies_) - 1 - place[body];
  };
  std::vector<std::vector<std::size_t>> rows_of(bodies_);  // links
  bool has_loops = false;
  for (std::size_t l = 0; l < links_.size(); ++l) {
    const End& a = links_[l].ends[0];
    const End& b = links_[l].ends[1];
    std::size_t lower = a.dofs > 0 ? a.point : b.point;
    if (a.dofs > 0 && b.dofs > 0) {
      if (place[b.point] > place[a.point]) lower = b.point;
      const std::size_t upper = lower == a.point ? b.point : a.point;
      has_loops = has_loops || parent[lower] != static_cast<int>(upper);
    }
    rows_of[lower].push_back(l);
  }
  std::vector<std::vector<std::size_t>> coupled_of(bodies_);
  for (std::size_t c = 0; c < coupled_.size(); ++c) {
    const auto& ends = links_[coupled_[c].terms[0].link].ends;
    coupled_of[ends[1].dofs > 0 ? ends[1].point : ends[0].point].push_back(c);
  }
  first_unknown_.assign(bodies_, 0);
  int unknown = 0;
  for (std::size_t k = bodies_; k-- > 0;) {
    const std::size_t body = found[k];
    SaddleLu::Node& node = nodes[at(node_of(body))];
    node.dofs = body < turning_ ? 6 : 3;
    node.parent = parent[body] < 0 ? -1 : node_of(at(parent[body]));
    first_unknown_[body] = unknown;
    unknown += node.dofs;
    for (const std::size_t l : rows_of[body]) {
      links_[l].unknown = unknown;
      unknown += links_[l].rows;
      node.rows += links_[l].rows;
    }
    for (const std::size_t c : coupled_of[body]) {
      coupled_[c].unknown = unknown++;
      ++node.rows;
    }
    may_depend_ = may_depend_ || rows_of[body].size() > 1 || !coupled_of[body].empty();
  }
  may_depend_ = (may_depend_ || has_loops) && equations.rows() > 0;
  for (Link& link : links_)
    for (End& end : link.ends)
      if (end.dofs > 0) end.unknown = first_unknown_[end.point];

  std::vector<SaddleLu::Link> links(links_.size());
  for (std::size_t body = 0; body < bodies_; ++body) {
    for (const std::size_t l : rows_of[body]) {
      const auto& ends = links_[l].ends;
      const End& other = ends[ends[0].point == body ? 1 : 0];
      links[l] = {links_[l].unknown, links_[l].rows, node_of(body),
                  other.dofs > 0 ? node_of(other.point) : -1};
    }
  }
  for (std::size_t body = 0; body < bodies_; ++body) {
    for (const std::size_t c : coupled_of[body]) {
      std::vector<int> others;  // than this one
      for (const CoupledRow::Term& term : coupled_[c].terms) {
        for (const End& end : links_[term.link].ends) {
          if (end.dofs == 0 || end.point == body) continue;
          const int node = node_of(end.point);
          if (std::find(others.begin(), others.end(), node) == others.end()) others.push_back(node);
        }
      }
      others.resize(3, -1);
      links.push_back({coupled_[c].unknown, 1, node_of(body), others[0], {others[1], others[2]}});
    }
  }
  lu_.analyze(nodes, links);
}

// where what a link adds goes, in the order in which it is added
void ImplicitStep::find_slots() {
  for (Link& link : links_) {
    link.slot = slots_.size();
    if (link.is_between_points) {
      for (const End& row : link.ends) {
        for (const End& column : link.ends)
          for (int k = 0; k < 3 && row.dofs > 0 && column.dofs > 0; ++k)
            slots_.push_back(lu_.slot(row.unknown + k, column.unknown + k));
        for (int k = 0; k < row.dofs; ++k) {
          slots_.push_back(lu_.slot(row.unknown + k, link.unknown));
          slots_.push_back(lu_.slot(link.unknown, row.unknown + k));
        }
      }
      slots_.push_back(lu_.slot(link.unknown, link.unknown));
      continue;
    }
    for (const End& row : link.ends) {
      for (const End& column : link.ends)
        for (int i = 0; i < row.dofs; ++i)
          for (int j = 0; j < column.dofs; ++j)
            slots_.push_back(lu_.slot(row.unknown + i, column.unknown + j));
      for (int i = 0; i < row.dofs; ++i) {
        for (int k = 0; k < link.rows; ++k) {
          slots_.push_back(lu_.slot(row.unknown + i, link.unknown + k));
          slots_.push_back(lu_.slot(link.unknown + k, row.unknown + i));
        }
      }
    }
    for (int k = 0; k < link.rows; ++k)
      slots_.push_back(lu_.slot(link.unknown + k, link.unknown + k));
  }
  if (!coupled_.empty()) find_coupled_slots();
  for (std::size_t i = 0; i < bodies_; ++i) {
    const int first = first_unknown_[i];
    for (int k = 0; k < 3; ++k) diagonal_.push_back(lu_.slot(first + k, first + k));
    if (i >= turning_) continue;
    for (int k = 3; k < 6; ++k)
      for (int m = 3; m < 6; ++m) diagonal_.push_back(lu_.slot(first + k, first + m));
  }
}

// ---- the state that is carried

void ImplicitStep::load(const std::vector<BodyState>& states, const EquationsOfMotion& equations) {
  lu_.forget();
  for (std::size_t i = 0; i < bodies_; ++i) {
    const BodyState& state = states[at(equations.bodies()[i])];
    x_[i] = state.position;
    v_[i] = state.linear_velocity;
    if (i >= turning_) continue;
    q_[i] = state.orientation;
    spin_[i] = state.angular_velocity;
  }
}

void ImplicitStep::store(const EquationsOfMotion& equations, std::vector<BodyState>* states) const {
  for (std::size_t i = 0; i < bodies_; ++i) {
    BodyState& state = (*states)[at(equations.bodies()[i])];
    state.position = x_[i];
    state.linear_velocity = v_[i];
    if (i >= turning_) continue;
    state.orientation = q_[i];
    state.angular_velocity = spin_[i];
  }
}

void ImplicitStep::write_points(Points* points) const {
  points->position.assign(x_.begin(), x_.begin() + static_cast<std::ptrdiff_t>(bodies_));
  points->velocity.assign(v_.begin(), v_.begin() + static_cast<std::ptrdiff_t>(bodies_));
  for (std::size_t i = 0; i < turning_; ++i) {
    const Matrix3d arms = radius_[i] * q_[i].toRotationMatrix();
    for (int k = 0; k < 3; ++k) {
      points->position.push_back(x_[i] + arms.col(k));
      points->velocity.push_back(v_[i] + spin_[i].cross(arms.col(k)));
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

// what a step would do without forces, and what it has to add up to
void ImplicitStep::predict() {
  const double h = h_;
  for (std::size_t i = 0; i < bodies_; ++i) {
    p_[i] = h * v_[i];
    if (rule_ == ImplicitRule::kBdf2)
      p_[i] = dx_before_[i] / 3.0 + h / 9.0 * (8.0 * v_[i] - 2.0 * v_before_[i]);
    v_before_[i] = v_[i];
  }
  for (std::size_t i = 0; i < turning_; ++i) {
    Turning& turn = turn_[i];
    turn.R0 = q_[i].toRotationMatrix();
    turn.J0 = turn.R0 * inertia_[i].asDiagonal() * turn.R0.transpose();
    const Vector3d L = turn.J0 * spin_[i];
    switch (rule_) {
      case ImplicitRule::kMidpoint:
        turn.a = 0.5 * h * spin_[i];
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
  set_rule(h, rule);
  predict();
  equations->move_with_time(t);
  for (std::size_t p = bodies_; p < x_.size(); ++p) x_[p] = equations->position(p);
  scale_ = 0.0;
  for (const Vector3d& x : x_) scale_ = std::max(scale_, x.cwiseAbs().maxCoeff());
  if (scale_ == 0.0) scale_ = 1.0;  // of points in one place
  for (std::size_t l = 0; l < links_.size(); ++l) {
    const Link& link = links_[l];
    Shape& shape = shapes_[l];
    shape.d0 = x_[link.ends[1].point] - x_[link.ends[0].point];
    for (std::size_t e = 0; e < 2; ++e) {
      const End& end = link.ends[e];
      shape.r0[e].setZero();
      if (end.dofs < 6) continue;
      const bool is_frame = e == 1 && link.kind == Kind::kGeneral;
      shape.r0[e] = turn_[end.point].R0 * (is_frame ? equations->frame_b(l).anchor : end.anchor);
      shape.d0 += end.sign * shape.r0[e];
      scale_ = std::max(scale_, end.anchor.norm());
    }
    if (link.kind == Kind::kSpring)  // what its law has of the start; the rest once that is known
      shape.target = equations->length(l).value;
    // inverse of what 1 N moves, or of a rod λ = 1
    double compliance = 0.0;
    for (std::size_t e = 0; e < 2; ++e) {
      const End& end = link.ends[e];
      if (end.dofs == 0) continue;
      compliance += 1.0 / mass_[end.point];
      if (end.dofs == 6) compliance += shape.r0[e].squaredNorm() / inertia_[end.point].mean();
    }
    shape.scale = 1.0 / std::sqrt(compliance);
    if (link.kind == Kind::kGeneral) {
      place_axes(*equations, link, &shape.axes0);
      begin_general(link, &shape);
      scale_ = std::max(scale_, link.radius);
    }
    if (link.kind == Kind::kRod) shape.scale /= shape.d0.norm();
    shape.is_left_out = shape.is_redundant = {};
  }
  for (CoupledRow& coupled : coupled_) coupled.is_left_out = coupled.is_redundant = false;
  if (may_depend_ && !leave_out_dependent(t, equations)) return false;

  equations->move_with_time(t + h);
  for (std::size_t p = bodies_; p < x_.size(); ++p) shift_[p] = equations->position(p) - x_[p];
  for (std::size_t l = 0; l < links_.size(); ++l) {
    const Link& link = links_[l];
    Shape& shape = shapes_[l];
    if (link.kind == Kind::kGeneral) {
      place_axes(*equations, link, &shape.axes1);
      shape.next_axes_B = shape.axes1[1];
      const End& b = link.ends[1];
      shape.next_r_B = shape.r0[1];
      if (b.dofs == 6) shape.next_r_B = turn_[b.point].R0 * equations->frame_b(l).anchor;
    }
    if (link.kind == Kind::kBall || link.kind == Kind::kGeneral) {
      shape.offset = equations->offset(l);
      if (link.rows > link.rigid_rows) begin_softs(link, shape, *equations);
      continue;
    }
    const double length = equations->length(l).value;
    scale_ = std::max(scale_, length);
    if (link.kind == Kind::kRod) {
      shape.target = 0.5 * length * length;
      continue;
    }
    // midpoint: σ = −k (½(s₀ + s₁) − ½(ℓ₀ + ℓ₁)) − (c/h)(s₁ − s₀ − (ℓ₁ − ℓ₀))
    // BDF2:     σ = −k (s₁ − ℓ₁) − (c/2h)(3 s₁ − 4 s₀ + s₋) + c ℓ̇₁;
    // each divided by what it has of s₁
    const double k = link.stiffness;
    const double rate = link.damping / h;
    const double s0 = shape.d0.norm();
    const double speed = equations->length(l).rate;
    switch (rule) {
      case ImplicitRule::kMidpoint:
        shape.compliance = 1.0 / (0.5 * k + rate);
        shape.target = length - shape.compliance * (0.5 * k - rate) * (s0 - shape.target);
        break;
      case ImplicitRule::kBdf2:
        shape.compliance = 1.0 / (k + 1.5 * rate);
        shape.target = shape.compliance *
                       (k * length + link.damping * speed + rate * (2.0 * s0 - 0.5 * shape.before));
        break;
    }
    shape.before = s0;
    shape.scale =
        1.0 / std::sqrt(1.0 / (shape.scale * shape.scale) + std::abs(shape.compliance) / s_);
  }

  for (std::size_t i = 0; i < bodies_; ++i) {
    force_[i] = mass_[i] * equations->load_acceleration(i);
    const auto first = at(first_unknown_[i]);
    const double scale = 1.0 / std::sqrt(mass_[i]);
    std::fill_n(left_.begin() + static_cast<std::ptrdiff_t>(first), 3, scale);
    std::fill_n(right_.begin() + static_cast<std::ptrdiff_t>(first), 3, scale);
    if (i >= turning_) continue;
    torque_[i] = equations->load_torque(i);
    const double turning = 1.0 / std::sqrt(inertia_[i].mean());
    std::fill_n(left_.begin() + static_cast<std::ptrdiff_t>(first) + 3, 3, turning);
    std::fill_n(right_.begin() + static_cast<std::ptrdiff_t>(first) + 3, 3, turning);
  }
  for (std::size_t l = 0; l < links_.size(); ++l) {
    for (int k = 0; k < links_[l].rows; ++k) {
      const double scale =
          links_[l].kind == Kind::kGeneral ? shapes_[l].row_scale[k] : shapes_[l].scale;
      left_[at(links_[l].unknown + k)] = scale;
      right_[at(links_[l].unknown + k)] = scale / s_;
    }
  }
  if (!coupled_.empty()) begin_coupled(*equations);
  return true;
}

// Rows that follow from others have no λ in this step: with another one λ would wander.
bool ImplicitStep::leave_out_dependent(double t, EquationsOfMotion* equations) {
  if (!equations->find_dependent(t, x_, q_, kDependentPivot, &is_dependent_)) return false;
  for (std::size_t l = 0; l < links_.size(); ++l) {
    if (links_[l].kind == Kind::kSpring) continue;
    const std::size_t row = equations->row_of(l);
    for (std::size_t k = 0; k < at(links_[l].rigid_rows); ++k) {
      shapes_[l].is_left_out[k] = is_dependent_[row + k] != 0;
      shapes_[l].is_redundant[k] = is_dependent_[row + k] == EquationsOfMotion::kRedundant;
    }
  }
  for (CoupledRow& coupled : coupled_) {
    coupled.is_left_out = is_dependent_[coupled.row] != 0;
    coupled.is_redundant = is_dependent_[coupled.row] == EquationsOfMotion::kRedundant;
  }
  return true;
}

void ImplicitStep::evaluate(const Unknowns& unknowns) {
  std::fill(lu_.values().begin(), lu_.values().end(), 0.0);
  worst_row_ = worst_momentary_row_ = 0.0;
  evaluate_bodies(unknowns);
  for (std::size_t l = 0; l < links_.size(); ++l) {
    if (links_[l].is_between_points)
      evaluate_rod(links_[l], &shapes_[l], unknowns);
    else if (links_[l].kind == Kind::kGeneral)
      evaluate_general(links_[l], &shapes_[l], unknowns);
    else
      evaluate_link(links_[l], &shapes_[l], unknowns);
  }
  for (CoupledRow& coupled : coupled_) evaluate_coupled(&coupled, unknowns);
  // of ½ŵ T, now that all of T is known
  std::size_t slot = 0;
  for (std::size_t i = 0; i < turning_; ++i) {
    slot += 3;
    const double scale = left_[at(first_unknown_[i]) + 3] * right_[at(first_unknown_[i]) + 3];
    const Matrix3d change = (-0.5 * s_ * scale) * cross_matrix(turn_[i].torque);
    for (int k = 0; k < 3; ++k)
      for (int m = 0; m < 3; ++m) lu_.values()[diagonal_[slot++]] += change(k, m);
  }
  for (std::size_t u = 0; u < residual_.size(); ++u) residual_[u] *= left_[u];
}

// what there is without the links
void ImplicitStep::evaluate_bodies(const Unknowns& unknowns) {
  double* const values = lu_.values().data();
  std::size_t slot = 0;
  for (std::size_t i = 0; i < bodies_; ++i) {
    const auto first = at(first_unknown_[i]);
    const ConstVector dx(unknowns.data() + first);
    Vector(residual_.data() + first) = mass_[i] * (dx - p_[i]) - s_ * force_[i];
    for (int k = 0; k < 3; ++k) values[diagonal_[slot++]] += 1.0;
    if (i >= turning_) continue;

    Turning& turn = turn_[i];
    const ConstVector w(unknowns.data() + first + 3);
    const Vector3d J_w = turn.J0 * (w - turn.a);
    turn.B = mean_rotation(w);
    turn.C = Matrix3d::Identity() - 0.5 * cross_matrix(w);
    turn.torque = torque_[i];
    Vector(residual_.data() + first + 3) =
        J_w + 0.5 * w.cross(J_w) - turn.C * (turn.b + s_ * torque_[i]);
    const Matrix3d derivative =
        (turn.J0 + 0.5 * (cross_matrix(w) * turn.J0 - cross_matrix(J_w + turn.b))) *
        (left_[first + 3] * right_[first + 3]);
    for (int k = 0; k < 3; ++k)
      for (int m = 0; m < 3; ++m) values[diagonal_[slot++]] += derivative(k, m);
  }
}

// d at both ends of the step, and what pulls
void ImplicitStep::evaluate_link(const Link& link, Shape* shape, const Unknowns& unknowns) {
  double* const values = lu_.values().data();
  Vector3d change = Vector3d::Zero();  // of d
  Vector3d arm[2];                     // where forces are taken
  Eigen::Matrix<double, 3, 6> E[2];    // of d at the end, without the sign of the body's end
  for (std::size_t e = 0; e < 2; ++e) {
    const End& end = link.ends[e];
    if (end.dofs == 0) {
      change += end.sign * shift_[end.point];
      continue;
    }
    const auto first = at(end.unknown);
    change += end.sign * ConstVector(unknowns.data() + first);
    E[e].leftCols<3>().setIdentity();
    if (end.dofs < 6) continue;
    const Turning& turn = turn_[end.point];
    const Vector3d mean_arm = turn.B * shape->r0[e];
    const Vector3d arm_change = ConstVector(unknowns.data() + first + 3).cross(mean_arm);
    change += end.sign * arm_change;
    arm[e] = shape->r0[e] + share_ * arm_change;
    E[e].rightCols<3>() = -turn.B * cross_matrix(mean_arm);
  }
  const Vector3d d1 = shape->d0 + change;
  const Vector3d d = shape->d = shape->d0 + share_ * change;

  // the force on B, its derivatives by d and λ, the rows and their derivative by d1
  Matrix3d P = Matrix3d::Zero();
  Matrix3d pull = Matrix3d::Identity(), gradient = pull;  // columns; one of rods and springs
  Vector3d value;
  const double compliance = shape->compliance;
  const double lambda = unknowns[at(link.unknown)];
  switch (link.kind) {
    case Kind::kRod:
      shape->force = lambda * d;
      P.diagonal().setConstant(lambda);
      pull.col(0) = d;
      gradient.col(0) = d1;
      value[0] = 0.5 * d1.squaredNorm() - shape->target + compliance * lambda;
      note_row(*shape, 0, std::abs(value[0]) / std::sqrt(2.0 * shape->target));
      break;
    case Kind::kBall:
      for (int k = 0; k < 3; ++k)
        shape->force[k] = shape->is_left_out[at(k)] ? 0.0 : unknowns[at(link.unknown + k)];
      value = d1 - shape->offset.head<3>() + compliance * shape->force;
      for (int k = 0; k < 3; ++k) note_row(*shape, at(k), std::abs(value[k]));
      break;
    case Kind::kGeneral:
      break;  // evaluate_general()
    case Kind::kSpring: {
      const double s1 = d1.norm();
      const double s = (1.0 - share_) * shape->d0.norm() + share_ * s1;
      const Vector3d n1 = s1 > 0.0 ? Vector3d(d1 / s1) : Vector3d(Vector3d::UnitX());
      const Vector3d n = s > 0.0 ? Vector3d(d / s) : Vector3d(Vector3d::UnitX());
      shape->force = lambda * n;
      if (s > 0.0) P = lambda / s * (Matrix3d::Identity() - n * n1.transpose());
      pull.col(0) = n;
      gradient.col(0) = n1;
      value[0] = compliance * lambda + s1 - shape->target;
      break;
    }
  }
  if (link.kind == Kind::kRod && shape->is_left_out[0]) {
    shape->force.setZero();
    P.setZero();
  }

  // what the force does to each end: [1; C r ×]
  Eigen::Matrix<double, 6, 3> H[2];
  for (std::size_t e = 0; e < 2; ++e) {
    const End& end = link.ends[e];
    if (end.dofs == 0) continue;
    H[e].topRows<3>().setIdentity();
    Vector(residual_.data() + end.unknown) -= s_ * end.sign * shape->force;
    if (end.dofs < 6) continue;
    Turning& turn = turn_[end.point];
    H[e].bottomRows<3>() = turn.C * cross_matrix(arm[e]);
    Vector(residual_.data() + end.unknown + 3) -=
        s_ * end.sign * (H[e].bottomRows<3>() * shape->force);
    turn.torque += end.sign * arm[e].cross(shape->force);
  }

  std::size_t slot = link.slot;
  const double scale = shape->scale;
  for (std::size_t e = 0; e < 2; ++e) {
    const End& row = link.ends[e];
    const double* const left = left_.data() + std::max(row.unknown, 0);
    for (std::size_t f = 0; f < 2; ++f) {
      const End& column = link.ends[f];
      if (row.dofs == 0 || column.dofs == 0) continue;
      Eigen::Matrix<double, 6, 6> K;
      K.topLeftCorner(row.dofs, column.dofs).noalias() = (-s_ * share_ * row.sign * column.sign) *
                                                         H[e].topRows(row.dofs) *
                                                         (P * E[f].leftCols(column.dofs)).eval();
      if (e == f && row.dofs == 6) {
        const Turning& turn = turn_[row.point];
        K.bottomRightCorner<3, 3>() +=
            (s_ * share_ * row.sign) * turn.C * cross_matrix(shape->force) * E[e].rightCols<3>();
      }
      const double* const right = right_.data() + column.unknown;
      for (int i = 0; i < row.dofs; ++i)
        for (int j = 0; j < column.dofs; ++j)
          values[slots_[slot++]] += left[i] * K(i, j) * right[j];
    }
    for (int i = 0; i < row.dofs; ++i) {
      for (int k = 0; k < link.rows; ++k) {
        // s of the column and 1/s of its scale cancel
        const double column = -row.sign * H[e].row(i).dot(pull.col(k));
        const double entry = row.sign * gradient.col(k).dot(E[e].col(i));
        const bool is_in = !shape->is_left_out[at(k)];
        values[slots_[slot++]] += is_in ? left[i] * column * scale : 0.0;
        values[slots_[slot++]] += is_in ? scale * entry * right_[at(row.unknown + i)] : 0.0;
      }
    }
  }
  for (int k = 0; k < link.rows; ++k) {
    const double diagonal = scale * compliance * right_[at(link.unknown)];
    const bool is_in = !shape->is_left_out[at(k)];
    values[slots_[slot++]] += is_in ? diagonal : 1.0;
    residual_[at(link.unknown + k)] = is_in ? value[k] : 0.0;
  }
}

// The same of a rod whose ends do not turn, where it is worth the lines.
void ImplicitStep::evaluate_rod(const Link& link, Shape* shape, const Unknowns& unknowns) {
  double* const values = lu_.values().data();
  Vector3d change = Vector3d::Zero();
  for (const End& end : link.ends)
    change += end.sign * (end.dofs > 0 ? Vector3d(ConstVector(unknowns.data() + end.unknown))
                                       : shift_[end.point]);
  const Vector3d d1 = shape->d0 + change;
  shape->d = shape->d0 + share_ * change;
  const bool is_in = !shape->is_left_out[0];
  const double lambda = is_in ? unknowns[at(link.unknown)] : 0.0;
  shape->force = lambda * shape->d;
  const double value = 0.5 * d1.squaredNorm() - shape->target + shape->compliance * lambda;
  note_row(*shape, 0, std::abs(value) / std::sqrt(2.0 * shape->target));

  const double scale = is_in ? shape->scale : 0.0;
  std::size_t slot = link.slot;
  for (const End& row : link.ends) {
    if (row.dofs == 0) continue;
    const double left = left_[at(row.unknown)];
    for (const End& column : link.ends) {
      if (column.dofs == 0) continue;
      const double K =
          -share_ * s_ * row.sign * column.sign * lambda * left * right_[at(column.unknown)];
      for (int k = 0; k < 3; ++k) values[slots_[slot++]] += K;
    }
    const double weight = row.sign * left * scale;
    for (int k = 0; k < 3; ++k) {
      values[slots_[slot++]] += -weight * shape->d[k];
      values[slots_[slot++]] += weight * d1[k];
    }
    Vector(residual_.data() + row.unknown) -= (s_ * row.sign) * shape->force;
  }
  values[slots_[slot]] += is_in ? scale * shape->compliance * right_[at(link.unknown)] : 1.0;
  residual_[at(link.unknown)] = is_in ? value : 0.0;
}

std::pair<double, double> ImplicitStep::largest_spin(double most_frequency) const {
  double spin = 0.0, speed = 0.0;
  for (std::size_t i = 0; i < turning_; ++i) {
    if (frequency_of(i) > most_frequency) continue;
    spin = std::max(spin, spin_[i].norm());
    speed = std::max(speed, spin_[i].norm() * radius_[i]);
  }
  return {spin, speed};
}

double ImplicitStep::add(const double* change, Unknowns* unknowns) const {
  double largest = 0.0;
  const auto consider = [&](double square) {
    if (!(square <= largest)) largest = square;  // a NaN stays
  };
  for (std::size_t u = 0; u < unknowns->size(); ++u) (*unknowns)[u] += right_[u] * change[u];
  for (std::size_t i = 0; i < bodies_; ++i) {
    const auto first = at(first_unknown_[i]);
    consider(right_[first] * right_[first] * ConstVector(change + first).squaredNorm());
    if (i >= turning_) continue;
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
    const double lambda = shape.is_left_out[0] ? 0.0 : unknowns[at(link.unknown)];
    double stiffness = 0.0;  // across the link
    RowVector impulse = RowVector::Zero();
    switch (link.kind) {
      case Kind::kRod:
        equations->add_impulse(l, h_ * lambda * length * RowVector::Unit(0));
        stiffness = std::abs(lambda);
        break;
      case Kind::kBall:
        impulse.head<3>() = h_ * shape.force;
        equations->add_impulse(l, impulse);
        break;
      case Kind::kGeneral:
        for (int k = 0; k < link.rigid_rows; ++k)
          if (!shape.is_left_out[at(k)]) impulse[k] = h_ * unknowns[at(link.unknown + k)];
        equations->add_impulse(l, impulse);
        for (int k = link.rigid_rows; k < link.rows; ++k) {
          const std::size_t s = link.first_soft + at(k - link.rigid_rows);
          equations->add_soft_impulse(s, h_ * unknowns[at(link.unknown + k)]);
          equations->set_position(s, softs_[s].end);
        }
        for (std::size_t e = 0; e < 2; ++e)
          if (link.ends[e].dofs == 6)
            squares_[link.ends[e].point] +=
                shape.swing[e] / inertia_[link.ends[e].point].minCoeff();
        continue;
      case Kind::kSpring:
        equations->add_impulse(l, h_ * lambda * RowVector::Unit(0));
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
    if (!coupled.is_left_out) equations->add_coupled_impulse(c, h_ * unknowns[at(coupled.unknown)]);
    for (std::size_t k = 0; k < 2; ++k) equations->set_position(c, k, coupled.terms[k].end);
  }
  frequency_ = std::sqrt(*std::max_element(squares_.begin(), squares_.end()));

  // of Δx or w, its like of the step before, and the velocity there
  const auto rate = [&](const Vector3d& change, const Vector3d& before, const Vector3d& velocity) {
    if (rule_ == ImplicitRule::kMidpoint) return Vector3d(2.0 / h_ * change - velocity);
    return Vector3d((1.5 * change - 0.5 * before) / h_);
  };
  for (std::size_t i = 0; i < bodies_; ++i) {
    const auto first = at(first_unknown_[i]);
    const ConstVector dx(unknowns.data() + first);
    x_[i] += dx;
    v_[i] = rate(dx, dx_before_[i], v_[i]);
    dx_before_[i] = dx;
    if (i >= turning_) continue;
    const ConstVector w(unknowns.data() + first + 3);
    const Vector3d spin = rate(w, w_before_[i], spin_[i]);
    w_before_[i] = w;
    spin_[i] = spin + w.cross(mean_rotation(w) * spin);
    const Vector3d half = 0.5 * w;
    const Eigen::Quaterniond turn(1.0, half.x(), half.y(), half.z());
    q_[i] = (turn * q_[i]).normalized();
  }
}

}  // namespace constraint_sim::engine
