#include "engine/methods/event_driven/contacts/contact_rows.h"

#include <algorithm>
#include <cmath>

namespace constraint_sim::engine {
namespace {

double response(std::size_t movable, const ContactRowPart& of, const ContactRowPart& to) {
  double sum = 0.0;
  if (of.a < movable) {
    if (of.a == to.a) sum += of.J.j1.dot(to.inv_M_F.j1) + of.J.j2.dot(to.inv_M_F.j2);
    if (of.a == to.b) sum += of.J.j1.dot(to.inv_M_F.j3) + of.J.j2.dot(to.inv_M_F.j4);
  }
  if (of.b < movable) {
    if (of.b == to.a) sum += of.J.j3.dot(to.inv_M_F.j1) + of.J.j4.dot(to.inv_M_F.j2);
    if (of.b == to.b) sum += of.J.j3.dot(to.inv_M_F.j3) + of.J.j4.dot(to.inv_M_F.j4);
  }
  return sum;
}

// Computes J M⁻¹ F, the change of row `of` by a unit force of another row.
double response_of_rows(std::size_t movable, const ContactRow& of, const ContactRow& to) {
  double sum = response(movable, of, to);
  if (of.second) sum += response(movable, *of.second, to);
  if (to.second) sum += response(movable, of, *to.second);
  if (of.second && to.second) sum += response(movable, *of.second, *to.second);
  return sum;
}

}  // namespace

double ContactRowPart::times(const GroupMotions& motions, std::size_t movable) const {
  double sum = 0.0;
  if (a < movable) sum += J.j1.dot(motions.linear[a]) + J.j2.dot(motions.angular[a]);
  if (b < movable) sum += J.j3.dot(motions.linear[b]) + J.j4.dot(motions.angular[b]);
  return sum;
}

void ContactRowPart::push(double amount, std::size_t movable, GroupMotions* motions) const {
  if (a < movable) {
    motions->linear[a] += amount * inv_M_F.j1;
    motions->angular[a] += amount * inv_M_F.j2;
  }
  if (b < movable) {
    motions->linear[b] += amount * inv_M_F.j3;
    motions->angular[b] += amount * inv_M_F.j4;
  }
}

double ContactRow::times(const GroupMotions& motions, std::size_t movable) const {
  const double first = ContactRowPart::times(motions, movable);
  return second ? first + second->times(motions, movable) : first;
}

void ContactRow::push(double amount, std::size_t movable, GroupMotions* motions) const {
  ContactRowPart::push(amount, movable, motions);
  if (second) second->push(amount, movable, motions);
}

double ContactRow::driven_power(const GroupBodies& bodies) const {
  const double first = bodies.driven_power(a, b, J);
  return second ? first + bodies.driven_power(second->a, second->b, second->J) : first;
}

void ContactRows::factor(const GroupBodies& bodies, bool asks_rank) {
  const std::size_t m = rows_.size(), movable = bodies.movable();
  double* const A = factors_.resize(m);
  weight_.resize(m);
  for (std::size_t j = 0; j < m; ++j) {
    const ContactRow& to = rows_[j];
    for (std::size_t i = 0; i < m; ++i) {
      const ContactRow& of = rows_[i];
      A[m * j + i] = i < j && of.is_symmetric && to.is_symmetric
                         ? A[m * i + j]
                         : response_of_rows(movable, of, to);
    }
    double own = A[m * j + j];
    if (!to.is_symmetric)  // a slipping contact, which has no second part
      own = response(movable, to, ContactRowPart(bodies, to.a, to.b, to.J));
    weight_[j] = own > 0.0 ? to.share / std::sqrt(own) : 0.0;
  }
  const double* const weight = weight_.data();
  for (std::size_t j = 0; j < m; ++j)
    for (std::size_t i = 0; i < m; ++i) A[m * j + i] *= weight[i] * weight[j];
  if (!asks_rank && are_independent_) {
    factors_.factor_regular();
    return;
  }
  factors_.factor(LeastNormSolver::kDependentPivot);
  are_independent_ = factors_.is_regular();
}

bool ContactRows::solve(std::size_t movable, List<double>* lambda) {
  const bool has_reference =
      !are_independent_ && std::any_of(rows_.begin(), rows_.end(),
                                       [](const ContactRow& row) { return row.reference != 0.0; });
  if (has_reference) {
    reference_.set_zero(movable);
    for (const ContactRow& row : rows_) row.push(row.reference, movable, &reference_);
    for (std::size_t i = 0; i < rows_.size(); ++i)
      (*lambda)[i] -= rows_[i].times(reference_, movable);
  }
  for (std::size_t i = 0; i < rows_.size(); ++i) (*lambda)[i] *= weight_[i];
  factors_.solve(lambda->data());
  bool is_finite = true;
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    (*lambda)[i] *= weight_[i];
    if (has_reference && weight_[i] > 0.0) (*lambda)[i] += rows_[i].reference;
    is_finite = is_finite && std::isfinite((*lambda)[i]);
  }
  return is_finite;
}

bool ContactRows::find_change(const GroupBodies& bodies, double ContactRow::*by,
                              GroupMotions* change) {
  // Later stages of a substep rely on the rank that its first stage found.
  const bool are_independent = are_independent_;
  factor(bodies, true);
  lambda_.resize(rows_.size());
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    lambda_[i] = -(rows_[i].*by);
    rows_[i].reference = 0.0;
  }
  const bool is_solved = solve(bodies.movable(), &lambda_);
  are_independent_ = are_independent;
  if (!is_solved) return false;
  change->set_zero(bodies.movable());
  for (std::size_t i = 0; i < rows_.size(); ++i)
    rows_[i].push(lambda_[i], bodies.movable(), change);
  return true;
}

}  // namespace constraint_sim::engine
