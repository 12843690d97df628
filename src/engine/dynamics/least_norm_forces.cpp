#include "engine/dynamics/least_norm_forces.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "engine/math/list.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Share of each diagonal entry that is added to it, since bodies may move freely. Each solution
// leaves this share over a pivot of the missing forces.
constexpr double kAdded = 1e-10;
constexpr double kForceRounding = 1e-14;  // share of the forces missing at first
constexpr double kSameSum = 1e-9;         // imbalance at a body, as a share of the largest force

}  // namespace

LeastNormForces::LeastNormForces(const EquationsOfMotion& equations) {
  const std::size_t bodies = equations.bodies().size(), turning = equations.rotating();
  const auto unknowns_before = [&](std::size_t point) {
    return static_cast<int>(3 * point + 3 * std::min(point, turning));
  };
  List<std::pair<int, int>> pattern;
  const auto add = [](int first, std::size_t i) { return first + static_cast<int>(i); };
  for (std::size_t l = 0; l < equations.links().size(); ++l) {
    if (!equations.is_rod(l) && !equations.is_ball(l) && !equations.is_general(l))
      break;  // springs come last
    const EquationsOfMotion::Link& from = equations.links()[l];
    Link link{static_cast<int>(equations.rows_of(l)), {-1, -1}, {0, 0}, rows_.size(), 0};
    for (std::size_t e = 0; e < 2; ++e) {
      const std::size_t point = e == 0 ? from.a : from.b;
      if (point >= bodies) continue;
      link.unknown[e] = unknowns_before(point);
      link.unknowns[e] = point < turning ? 6 : 3;
    }
    rows_.resize(rows_.size() + to_index(link.rows), Row{});
    for_each_entry(link, [&](std::size_t e, std::size_t i, std::size_t f, std::size_t k) {
      pattern.emplace_back(add(link.unknown[e], i), add(link.unknown[f], k));
    });
    links_.push_back(link);
  }
  if (!equations.coupled_rows().empty()) add_coupled(equations, &pattern);
  const int n = unknowns_before(bodies);
  ldlt_.analyze(n, pattern);
  for (Link& link : links_) {
    link.first_slot = slots_.size();
    for_each_entry(link, [&](std::size_t e, std::size_t i, std::size_t f, std::size_t k) {
      slots_.push_back(ldlt_.slot(add(link.unknown[e], i), add(link.unknown[f], k)));
    });
  }
  for (CoupledRow& coupled : coupled_) {
    coupled.first_slot = slots_.size();
    for_each_entry(coupled, [&](const CoupledRow::End& end, std::size_t i,
                                const CoupledRow::End& other, std::size_t k) {
      slots_.push_back(ldlt_.slot(add(end.unknown, i), add(other.unknown, k)));
    });
  }
  for (int u = 0; u < n; ++u) diagonal_.push_back(ldlt_.slot(u, u));
  for (auto* list : {&stiffness_, &missing_, &permuted_}) list->assign(to_index(n), 0.0);
  is_torque_.assign(to_index(n), 0);
  for (std::size_t i = 0; i < turning; ++i) std::fill_n(&is_torque_[6 * i + 3], 3, 1);
  inverse_weights_.assign(rows_.size(), 0.0);
  impulses_.assign(rows_.size() + equations.links().size() - links_.size(), 0.0);
}

// Lists the bodies of coupled rows, each body once.
void LeastNormForces::add_coupled(const EquationsOfMotion& equations,
                                  List<std::pair<int, int>>* pattern) {
  for (const EquationsOfMotion::CoupledRow& from : equations.coupled_rows()) {
    CoupledRow& coupled = coupled_.emplace_back();
    for (const auto& term : from.terms) {
      const EquationsOfMotion::Link& of = equations.links()[term.link];
      for (std::size_t e = 0; e < 2; ++e) {
        const std::size_t point = e == 0 ? of.a : of.b;
        const Link& link = links_[term.link];
        const bool is_there =
            std::any_of(coupled.ends.begin(), coupled.ends.end(),
                        [&](const CoupledRow::End& end) { return end.point == point; });
        if (link.unknowns[e] > 0 && !is_there)
          coupled.ends.push_back({link.unknown[e], link.unknowns[e], point, {}});
      }
    }
    for_each_entry(coupled, [&](const CoupledRow::End& end, std::size_t i,
                                const CoupledRow::End& other, std::size_t k) {
      pattern->emplace_back(end.unknown + static_cast<int>(i), other.unknown + static_cast<int>(k));
    });
  }
}

template <class Visit>
void LeastNormForces::for_each_entry(const CoupledRow& coupled, Visit visit) {
  for (std::size_t e = 0; e < coupled.ends.size(); ++e)
    for (std::size_t i = 0; i < coupled.ends[e].unknowns; ++i)
      for (std::size_t f = 0; f <= e; ++f)
        for (std::size_t k = 0; k < (f == e ? i + 1 : coupled.ends[f].unknowns); ++k)
          visit(coupled.ends[e], i, coupled.ends[f], k);
}

// Visits the lower triangle of the unknowns of both ends: end and index of the row, then of the
// column.
template <class Visit>
void LeastNormForces::for_each_entry(const Link& link, Visit visit) const {
  for (std::size_t e = 0; e < 2; ++e)
    for (std::size_t i = 0; i < link.unknowns[e]; ++i)
      for (std::size_t f = 0; f <= e; ++f)
        for (std::size_t k = 0; k < (f == e ? i + 1 : link.unknowns[f]); ++k) visit(e, i, f, k);
}

void LeastNormForces::share(const EquationsOfMotion& equations, const List<BodyState>& states) {
  place(equations, states);
  if (!coupled_.empty()) place_coupled(equations, states);
  factor();
  gather_state(equations);
  find_shares();
  if (has_same_sum()) return;
  shares_ = impulses_;
  for (CoupledRow& coupled : coupled_) coupled.share = coupled.impulse;
}

RowVector LeastNormForces::impulse(const EquationsOfMotion& equations, std::size_t l) const {
  RowVector impulse = RowVector::Zero();
  if (l >= links_.size()) {
    impulse[0] = shares_[rows_.size() + l - links_.size()];
    return impulse;
  }
  for (int k = 0; k < links_[l].rows; ++k) impulse[k] = shares_[links_[l].first_row + to_index(k)];
  return equations.forces().by_function(equations, l, impulse);
}

// Vectors of a general joint at the given states.
JointVectors LeastNormForces::vectors_of(const EquationsOfMotion& equations,
                                         const List<BodyState>& states, std::size_t l,
                                         const std::array<Vector3d, 2>& arm,
                                         const Vector3d& d) const {
  const EquationsOfMotion::Link& from = equations.links()[l];
  JointVectors vectors;
  vectors.custom = from.custom;
  vectors.r_A = arm[0];
  vectors.r_B = arm[1];
  vectors.d = d;
  if (!info(from.kind).has_frames) return vectors;
  const auto axes = [&](std::size_t e, std::size_t point, const Matrix3d& frame) -> Matrix3d {
    if (links_[l].unknowns[e] == 0) return equations.inputs().fixed_axes(point) * frame;
    return states[equations.bodies()[point]].orientation * frame;
  };
  vectors.axes_A = axes(0, from.a, from.frame_a);
  vectors.axes_B = axes(1, from.b, equations.inputs().frame_b(l).axes);
  return vectors;
}

double LeastNormForces::coupled_impulse(const EquationsOfMotion& equations, std::size_t l) const {
  for (std::size_t c = 0; c < coupled_.size(); ++c)
    if (equations.coupled_rows()[c].link == l) return coupled_[c].share;
  return 0.0;
}

// Computes directions, torques and weights of the rows at the pose where the step ends.
void LeastNormForces::place(const EquationsOfMotion& equations, const List<BodyState>& states) {
  for (std::size_t l = 0; l < links_.size(); ++l) {
    const Link& link = links_[l];
    const EquationsOfMotion::Link& from = equations.links()[l];
    const std::array<std::size_t, 2> points{from.a, from.b};
    std::array<Vector3d, 2> arm{Vector3d::Zero(), Vector3d::Zero()};
    Vector3d d = Vector3d::Zero();
    const JointVectors vectors = place_ends(equations, states, l, &arm, &d);
    double sum = 0.0;
    for (int k = 0; k < link.rows; ++k) {
      std::array<Vector3d, 2> push, turn;  // force and torque of a unit impulse
      if (equations.is_general(l)) {
        const Jacobian J = jacobian(equations.form(l, to_index(k)), vectors);
        push = {J.j1, J.j3};
        turn = {J.j2, J.j4};
      } else {
        const Vector3d n = link.rows == 1 ? d.normalized() : Vector3d(Vector3d::Unit(k));
        push = {-n, n};
        turn = {-arm[0].cross(n), arm[1].cross(n)};
      }
      double row_weight = 0.0;
      for (std::size_t e = 0; e < 2; ++e) {
        if (link.unknowns[e] == 0) continue;
        double* const row = rows_[link.first_row + to_index(k)].data() + 6 * e;
        Eigen::Map<Vector3d> force(row), torque(row + 3);
        force = push[e];
        double weight = equations.inverse_mass(points[e]) * force.squaredNorm();
        if (link.unknowns[e] == 6) {
          torque = turn[e];
          const BodyState& state = states[equations.bodies()[points[e]]];
          const Vector3d in_body = state.orientation.conjugate() * torque;
          weight += in_body.dot(in_body.cwiseQuotient(equations.inertia(points[e])));
        }
        row_weight += weight;
      }
      sum += row_weight;
      inverse_weights_[link.first_row + to_index(k)] = 1.0 / row_weight;
    }
    if (equations.is_ball(l))  // no axis is preferred
      std::fill_n(&inverse_weights_[link.first_row], link.rows, link.rows / sum);
  }
}

// Computes arms and d of a joint. Returns the vectors of a general joint.
JointVectors LeastNormForces::place_ends(const EquationsOfMotion& equations,
                                         const List<BodyState>& states, std::size_t l,
                                         std::array<Vector3d, 2>* arm, Vector3d* d) const {
  const EquationsOfMotion::Link& from = equations.links()[l];
  for (std::size_t e = 0; e < 2; ++e) {
    const std::size_t point = e == 0 ? from.a : from.b;
    if (links_[l].unknowns[e] == 0) {
      *d += kEndSign[e] * equations.kinematics().position()[point];
      continue;
    }
    const BodyState& state = states[equations.bodies()[point]];
    if (links_[l].unknowns[e] == 6)
      (*arm)[e] =
          state.orientation * (e == 0                    ? from.anchor_a
                               : equations.is_general(l) ? equations.inputs().frame_b(l).anchor
                                                         : from.anchor_b);
    *d += kEndSign[e] * (state.position + (*arm)[e]);
  }
  return equations.is_general(l) ? vectors_of(equations, states, l, *arm, *d) : JointVectors();
}

void LeastNormForces::place_coupled(const EquationsOfMotion& equations,
                                    const List<BodyState>& states) {
  for (std::size_t c = 0; c < coupled_.size(); ++c) {
    CoupledRow& coupled = coupled_[c];
    for (CoupledRow::End& end : coupled.ends) end.row.fill(0.0);
    for (const auto& term : equations.coupled_rows()[c].terms) {
      std::array<Vector3d, 2> arm{Vector3d::Zero(), Vector3d::Zero()};
      Vector3d d = Vector3d::Zero();
      const JointVectors vectors = place_ends(equations, states, term.link, &arm, &d);
      const Jacobian J = jacobian(term.form, vectors);
      const EquationsOfMotion::Link& of = equations.links()[term.link];
      for (CoupledRow::End& end : coupled.ends) {
        Eigen::Map<Vector3d> force(end.row.data()), torque(end.row.data() + 3);
        if (end.point == of.a) force += term.ratio * J.j1;
        if (end.point == of.b) force += term.ratio * J.j3;
        if (end.unknowns < 6) continue;
        if (end.point == of.a) torque += term.ratio * J.j2;
        if (end.point == of.b) torque += term.ratio * J.j4;
      }
    }
    double weight = 0.0;
    for (const CoupledRow::End& end : coupled.ends) {
      const Eigen::Map<const Vector3d> force(end.row.data()), torque(end.row.data() + 3);
      weight += equations.inverse_mass(end.point) * force.squaredNorm();
      if (end.unknowns < 6) continue;
      const Vector3d in_body =
          states[equations.bodies()[end.point]].orientation.conjugate() * torque;
      weight += in_body.dot(in_body.cwiseQuotient(equations.inertia(end.point)));
    }
    coupled.inverse_weight = 1.0 / weight;
  }
}

void LeastNormForces::factor() {
  List<double>& K = ldlt_.values();
  std::fill(K.begin(), K.end(), 0.0);
  for (const Link& link : links_) {
    std::array<std::array<double, 12>, 12> sum{};  // lower triangle of both ends
    for (std::size_t r = link.first_row; r < link.first_row + to_index(link.rows); ++r) {
      const double* const row = rows_[r].data();
      for (std::size_t i = 0; i < 12; ++i) {
        const double weighted = inverse_weights_[r] * row[i];
        if (weighted == 0.0) continue;  // half of the entries, and all of a fixed end
        for (std::size_t k = 0; k <= i; ++k) sum[i][k] += weighted * row[k];
      }
    }
    const SparseLdlt::Slot* slot = slots_.data() + link.first_slot;
    for_each_entry(link, [&](std::size_t e, std::size_t i, std::size_t f, std::size_t k) {
      K[*slot++] += sum[6 * e + i][6 * f + k];
    });
  }
  for (const CoupledRow& coupled : coupled_) {
    const SparseLdlt::Slot* slot = slots_.data() + coupled.first_slot;
    for_each_entry(coupled, [&](const CoupledRow::End& end, std::size_t i,
                                const CoupledRow::End& other, std::size_t k) {
      K[*slot++] += coupled.inverse_weight * end.row[i] * other.row[k];
    });
  }
  for (std::size_t u = 0; u < diagonal_.size(); ++u) {
    stiffness_[u] = K[diagonal_[u]];
    K[diagonal_[u]] *= 1.0 + kAdded;
  }
  ldlt_.factor(0.01 * kAdded);
}

// ---- shares of the impulses

// Reads the impulses of rows, then of springs.
void LeastNormForces::gather_state(const EquationsOfMotion& equations) {
  std::size_t i = 0;
  for (std::size_t l = 0; l < equations.links().size(); ++l) {
    const RowVector impulse = equations.forces().row_impulse(equations, l);
    for (int k = 0; k < (l < links_.size() ? links_[l].rows : 1); ++k) impulses_[i++] = impulse[k];
  }
  shares_ = impulses_;
  std::fill_n(shares_.begin(), rows_.size(), 0.0);
  for (std::size_t c = 0; c < coupled_.size(); ++c) {
    coupled_[c].impulse =
        equations.forces().coupled_impulse(equations, equations.coupled_rows()[c].link);
    coupled_[c].share = 0.0;
  }
}

// Refines the shares with the regularized matrix until the missing forces are rounding.
void LeastNormForces::find_shares() {
  const double all = find_missing();
  double before = kInfinity;
  for (double missing = all; missing > kForceRounding * all && missing <= 0.5 * before;) {
    before = missing;
    add_shares();
    missing = find_missing();
  }
}

// Computes Gᵀ of the impulses not distributed yet. Returns the largest entry, relative to the
// stiffness of its unknown.
double LeastNormForces::find_missing() {
  std::fill(missing_.begin(), missing_.end(), 0.0);
  for (const Link& link : links_) {
    for (std::size_t r = link.first_row; r < link.first_row + to_index(link.rows); ++r) {
      const double impulse = impulses_[r] - shares_[r];
      for (std::size_t e = 0; e < 2; ++e) {
        const double* const row = rows_[r].data() + 6 * e;
        for (std::size_t k = 0; k < link.unknowns[e]; k += 3)  // force, then torque
          Eigen::Map<Vector3d>(&missing_[to_index(link.unknown[e]) + k]) +=
              impulse * Eigen::Map<const Vector3d>(row + k);
      }
    }
  }
  for (const CoupledRow& coupled : coupled_)
    for (const CoupledRow::End& end : coupled.ends)
      for (std::size_t k = 0; k < end.unknowns; ++k)
        missing_[to_index(end.unknown) + k] += (coupled.impulse - coupled.share) * end.row[k];
  double largest = 0.0;
  for (std::size_t u = 0; u < missing_.size(); ++u)
    if (stiffness_[u] > 0.0)
      largest = std::max(largest, std::abs(missing_[u]) / std::sqrt(stiffness_[u]));
  return largest;
}

// Adds λ += D⁻¹ G z.
void LeastNormForces::add_shares() {
  for (std::size_t u = 0; u < missing_.size(); ++u)
    permuted_[ldlt_.place(static_cast<int>(u))] = missing_[u];
  ldlt_.solve(permuted_.data());
  for (std::size_t u = 0; u < missing_.size(); ++u)
    missing_[u] = permuted_[ldlt_.place(static_cast<int>(u))];
  for (const Link& link : links_) {
    for (std::size_t r = link.first_row; r < link.first_row + to_index(link.rows); ++r) {
      double sum = 0.0;
      for (std::size_t e = 0; e < 2; ++e)
        for (std::size_t k = 0; k < link.unknowns[e]; ++k)
          sum += rows_[r][6 * e + k] * missing_[to_index(link.unknown[e]) + k];
      shares_[r] += inverse_weights_[r] * sum;
    }
  }
  for (CoupledRow& coupled : coupled_) {
    double sum = 0.0;
    for (const CoupledRow::End& end : coupled.ends)
      for (std::size_t k = 0; k < end.unknowns; ++k)
        sum += end.row[k] * missing_[to_index(end.unknown) + k];
    coupled.share += coupled.inverse_weight * sum;
  }
}

// Whether the shares give the same force and torque on each body as the impulses, to rounding.
bool LeastNormForces::has_same_sum() const {
  double force = 0.0, torque = 0.0;  // largest of any row
  for (std::size_t r = 0; r < rows_.size(); ++r) {
    const double most = std::max(std::abs(impulses_[r]), std::abs(shares_[r]));
    force = std::max(force, most);
    for (const double* const end : {rows_[r].data(), rows_[r].data() + 6})
      torque = std::max(torque, most * Eigen::Map<const Vector3d>(end + 3).norm());
  }
  for (const CoupledRow& coupled : coupled_) {
    const double most = std::max(std::abs(coupled.impulse), std::abs(coupled.share));
    for (const CoupledRow::End& end : coupled.ends) {
      force = std::max(force, most * Eigen::Map<const Vector3d>(end.row.data()).norm());
      torque = std::max(torque, most * Eigen::Map<const Vector3d>(end.row.data() + 3).norm());
    }
  }
  for (std::size_t u = 0; u < missing_.size(); ++u)
    if (!(std::abs(missing_[u]) <= kSameSum * (is_torque_[u] ? torque : force))) return false;
  return true;
}

}  // namespace constraint_sim::engine
