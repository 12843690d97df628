#include "engine/dynamics/delassus_matrix.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "engine/math/list.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

}  // namespace

// ---- compilation

void DelassusMatrix::compile(const IslandModel& island, const List<char>& is_redundant) {
  const std::size_t bodies = island.bodies().size(), rows = island.rows();
  List<List<End>> ends_on(bodies), kept_on(bodies);
  for (std::size_t i = 0; i < island.parts(); ++i) {
    const IslandModel::Row& row = island.part(i);
    if (row.a < bodies) ends_on[row.a].push_back({i, -1.0, row.block_a});
    if (row.b < bodies) ends_on[row.b].push_back({i, 1.0, row.block_b});
  }
  List<int> number(rows, -1);  // number of a row among the kept rows
  kept_ = 0;
  for (std::size_t i = 0; i < rows; ++i)
    if (!is_redundant[i]) number[i] = static_cast<int>(kept_++);
  const auto number_of = [&](const End& end) { return number[island.row_of_part(end.part)]; };

  List<std::pair<int, int>> pattern;
  for (std::size_t body = 0; body < bodies; ++body) {
    auto& ends = kept_on[body];
    std::copy_if(ends_on[body].begin(), ends_on[body].end(), std::back_inserter(ends),
                 [&](const End& end) { return number_of(end) >= 0; });
    for (std::size_t m = 0; m < ends.size(); ++m)
      for (std::size_t n = 0; n < m; ++n)
        pattern.emplace_back(number_of(ends[m]), number_of(ends[n]));
  }
  ldlt_.analyze(static_cast<int>(kept_), pattern);
  has_factors_ = false;

  std::size_t last = kept_;
  unknown_.resize(rows);
  for (std::size_t i = 0; i < rows; ++i)
    unknown_[i] = is_redundant[i] ? last++ : to_index(ldlt_.place(number[i]));
  block_unknown_.clear();
  for (const IslandModel::AngularBlock& block : island.angular_blocks())
    block_unknown_.push_back(unknown_[island.row_of_part(block.row)]);
  list_pulls(island, ends_on);
  list_couplings(island, number, kept_on);
  force_.assign(island.points(), Vector3d::Zero());
  torque_.assign(island.rotating(), Vector3d::Zero());
}

void DelassusMatrix::list_pulls(const IslandModel& island, const List<List<End>>& ends_on) {
  pulls_.clear();
  pulls_end_.clear();
  for (const auto& ends : ends_on) {
    for (const End& end : ends)
      pulls_.push_back({end.part, unknown_[island.row_of_part(end.part)], end.sign});
    pulls_end_.push_back(pulls_.size());
  }
}

void DelassusMatrix::list_couplings(const IslandModel& island, const List<int>& number,
                                    const List<List<End>>& kept_on) {
  const std::size_t first_ball = island.first().ball;
  const std::size_t first_general = island.first_general_row();
  const std::size_t first_coupled = island.first_coupled_row();
  const auto number_of = [&](const End& end) { return number[island.row_of_part(end.part)]; };
  const auto are_two_axes = [&](std::size_t i, std::size_t j) {
    const auto is_general = [&](std::size_t row) { return row >= first_general; };
    const auto has_no_force = [&](std::size_t row) {
      return is_general(row) && row < first_coupled &&
             !island.general_rows()[row - first_general].form.has_separation();
    };
    if (has_no_force(i) || has_no_force(j)) return true;
    if (is_general(i) || is_general(j)) return false;
    return i >= first_ball && j >= first_ball && (i - first_ball) % 3 != (j - first_ball) % 3;
  };
  linear_couplings_.clear();
  for (std::size_t i = 0; i < island.parts(); ++i) {
    const int k = number[island.row_of_part(i)];
    if (k >= 0) linear_couplings_.push_back({i, i, island.part(i).inverse_mass, ldlt_.slot(k, k)});
  }
  angular_couplings_.clear();
  for (std::size_t body = 0; body < kept_on.size(); ++body) {
    const auto& ends = kept_on[body];
    for (std::size_t m = 0; m < ends.size(); ++m) {
      for (std::size_t n = 0; n < m; ++n) {
        if (are_two_axes(ends[m].part, ends[n].part)) continue;
        const double twice = number_of(ends[m]) == number_of(ends[n]) ? 2.0 : 1.0;
        linear_couplings_.push_back(
            {ends[m].part, ends[n].part,
             twice * ends[m].sign * ends[n].sign * island.inverse_mass(body),
             ldlt_.slot(number_of(ends[m]), number_of(ends[n]))});
      }
      if (!island.rotates(body)) continue;
      for (std::size_t n = 0; n <= m; ++n) {
        const AngularCoupling coupling{to_index(ends[m].block), to_index(ends[n].block),
                                       ldlt_.slot(number_of(ends[m]), number_of(ends[n]))};
        angular_couplings_.push_back(coupling);
        if (n < m && number_of(ends[m]) == number_of(ends[n]))  // both parts of one row
          angular_couplings_.push_back({coupling.q, coupling.p, coupling.slot});
      }
    }
  }
}

// ---- one evaluation

void DelassusMatrix::evaluate(const Kinematics& kinematics) {
  List<double>& A = ldlt_.values();
  std::fill(A.begin(), A.end(), 0.0);
  const List<Vector3d>& J = kinematics.J_linear();
  for (const LinearCoupling& c : linear_couplings_)
    A[c.slot] += c.inverse_mass * J[c.i].dot(J[c.j]);
  const List<Vector3d>&J_angular = kinematics.J_angular(), &M_inv_Jt = kinematics.M_inv_Jt();
  for (const AngularCoupling& c : angular_couplings_)
    A[c.slot] += J_angular[c.p].dot(M_inv_Jt[c.q]);
}

void DelassusMatrix::factor(double least) {
  left_out_ = ldlt_.factor(least);
  has_factors_ = true;
}

void DelassusMatrix::solve(double* b) {
  if (left_out_ > dependent_) dependent_ = left_out_;
  if (kept_ < unknown_.size()) std::fill(b + kept_, b + unknown_.size(), 0.0);
  ldlt_.solve(b);
}

void DelassusMatrix::refine(double* residual, double* lambda) const {
  ldlt_.solve(residual);
  for (std::size_t u = 0; u < kept_; ++u)
    if (!ldlt_.is_left_out(u)) lambda[u] += residual[u];
}

void DelassusMatrix::apply_transpose(const IslandModel& island, const Kinematics& kinematics,
                                     const double* lambda) {
  const List<Vector3d>& J = kinematics.J_linear();
  std::size_t pull = 0;
  for (std::size_t i = 0; i < pulls_end_.size(); ++i) {
    Vector3d sum = Vector3d::Zero();
    for (; pull < pulls_end_[i]; ++pull)
      sum += pulls_[pull].sign * lambda[pulls_[pull].unknown] * J[pulls_[pull].row];
    force_[i] = sum;
  }
  for (Vector3d& torque : torque_) torque.setZero();
  for (std::size_t p = 0; p < block_unknown_.size(); ++p)
    torque_[island.angular_blocks()[p].body] +=
        lambda[block_unknown_[p]] * kinematics.J_angular()[p];
}

void DelassusMatrix::find_residual(const IslandModel& island, const Kinematics& kinematics,
                                   const double* b, const double* lambda, double* residual) {
  apply_transpose(island, kinematics, lambda);
  std::copy_n(b, unknown_.size(), residual);
  subtract_accelerations(island, kinematics, force_, torque_, residual);
}

void DelassusMatrix::subtract_accelerations(const IslandModel& island, const Kinematics& kinematics,
                                            const List<Vector3d>& force,
                                            const List<Vector3d>& torque, double* b) const {
  for (std::size_t i = 0; i < island.parts(); ++i) {
    const IslandModel::Row& row = island.part(i);
    const Vector3d a =
        island.inverse_mass(row.b) * force[row.b] - island.inverse_mass(row.a) * force[row.a];
    b[unknown_[island.row_of_part(i)]] -= kinematics.J_linear()[i].dot(a);
  }
  for (std::size_t p = 0; p < block_unknown_.size(); ++p)
    b[block_unknown_[p]] -= kinematics.M_inv_Jt()[p].dot(torque[island.angular_blocks()[p].body]);
}

void DelassusMatrix::subtract_angular(const IslandModel& island, const Kinematics& kinematics,
                                      const List<Vector3d>& acceleration, double* b) const {
  for (std::size_t p = 0; p < block_unknown_.size(); ++p)
    b[block_unknown_[p]] -=
        kinematics.J_angular()[p].dot(acceleration[island.angular_blocks()[p].body]);
}

void DelassusMatrix::multipliers_to_forces(const IslandModel& island, const IntervalInputs& inputs,
                                           double* lambda) const {
  for (std::size_t l = 0; l < island.first().ball; ++l)
    lambda[unknown_[l]] *= inputs.length()[l].value;
}

}  // namespace constraint_sim::engine
