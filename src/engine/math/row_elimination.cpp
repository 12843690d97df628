#include "engine/math/row_elimination.h"

#include <algorithm>

#include "engine/math/least_norm_solver.h"

namespace constraint_sim::engine {
namespace {

// Most bounded rows: a step of Newton's method takes n³ operations.
constexpr std::size_t kMostBounded = 64;
// Most pairs of rows on a body, per row.
constexpr std::size_t kMostPairsPerRow = 64;
// Share of its diagonal entry of A up to which rows without bounds hold a row.
constexpr double kHeldShare = 1e-12;

}  // namespace

bool RowElimination::list_rows() {
  free_.clear();
  bounded_.clear();
  bounds_.clear();
  places_.assign(blocks_->problem().rows.size(), Place{});
  for (const Block& block : blocks_->all()) {
    if (block.d == 0.0) continue;
    const bool is_free = !blocks_->is_contact(block) && !blocks_->has_bounds(block);
    if (!is_free) bounds_.push_back(block);
    List<std::size_t>& rows = is_free ? free_ : bounded_;
    for (std::size_t i = block.first; i < block.first + block.size; ++i) {
      places_[i] = {is_free ? Place::kFree : Place::kBounded, rows.size(), block.d};
      rows.push_back(i);
    }
  }
  return !bounded_.empty() && bounded_.size() <= kMostBounded && free_.size() >= bounded_.size();
}

// Lists the parts of rows that can move, body after body; returns false where they have too many
// pairs.
bool RowElimination::list_parts() {
  const BodyConeProblem& problem = blocks_->problem();
  parts_end_.assign(problem.bodies.size() + 1, 0);
  const auto visit_parts = [&](const auto& visit) {
    for (std::size_t row = 0; row < problem.rows.size(); ++row)
      if (places_[row].kind != Place::kNone)
        for (std::size_t k = blocks_->parts_begin(row); k < blocks_->row(row).parts_end; ++k)
          visit(places_[row], problem.parts[k]);
  };
  std::size_t count = 0;
  visit_parts([&](const Place&, const BodyConeProblem::Part& part) {
    ++parts_end_[to_index(part.body) + 1];
    ++count;
  });
  std::size_t pairs = 0;
  for (std::size_t body = 0; body + 1 < parts_end_.size(); ++body) {
    pairs += parts_end_[body + 1] * parts_end_[body + 1];
    parts_end_[body + 1] += parts_end_[body];
  }
  if (pairs > kMostPairsPerRow * (free_.size() + bounded_.size())) return false;
  parts_.resize(count);
  visit_parts([&](const Place& place, const BodyConeProblem::Part& part) {
    const BodyConeProblem::Twist J = place.scale * part.J;
    parts_[parts_end_[to_index(part.body)]++] = {
        place, J, problem.bodies[to_index(part.body)].apply_inverse(J)};
  });  // each entry of parts_end_ is now the end of its body
  return true;
}

// Calls visit(first, second) for pairs of parts of the same body, also of a part with itself.
template <class Visit>
void RowElimination::visit_pairs(const Visit& visit) const {
  for (std::size_t body = 0, begin = 0; body < blocks_->problem().bodies.size(); ++body) {
    for (std::size_t k = begin; k < parts_end_[body]; ++k)
      for (std::size_t l = begin; l <= k; ++l) visit(parts_[k], parts_[l]);
    begin = parts_end_[body];
  }
}

void RowElimination::analyze() {
  entries_.clear();
  visit_pairs([&](const Part& k, const Part& l) {
    if (k.place.kind == Place::kFree && l.place.kind == Place::kFree)
      entries_.emplace_back(static_cast<int>(k.place.index), static_cast<int>(l.place.index));
  });
  if (entries_ == analyzed_) return;
  analyzed_ = entries_;
  factored_.clear();
  eliminated_.analyze(static_cast<int>(free_.size()), entries_);
  slots_.clear();
  for (const auto& [i, j] : entries_) slots_.push_back(eliminated_.slot(i, j));
}

bool RowElimination::set(const BodyConeBlocks& blocks) {
  blocks_ = &blocks;
  if (!list_rows() || !list_parts()) return false;
  analyze();
  const std::size_t m = free_.size(), n = bounded_.size();
  A_.assign(n * n, 0.0);
  couplings_.swap(known_couplings_);
  couplings_.assign(n * m, 0.0);
  List<double>& values = matrix_;
  values.assign(eliminated_.values().size(), 0.0);
  const auto place = [&](std::size_t f) {
    return to_index(eliminated_.place(static_cast<int>(f)));
  };
  std::size_t slot = 0;
  visit_pairs([&](const Part& k, const Part& l) {
    const double response = k.J.dot(l.inverse);
    const std::size_t i = k.place.index, j = l.place.index;
    if (k.place.kind == l.place.kind) {
      if (k.place.kind == Place::kFree)
        values[slots_[slot++]] += response;
      else
        A_[std::max(i, j) * n + std::min(i, j)] += response;
    } else if (k.place.kind == Place::kFree) {
      couplings_[j * m + place(i)] += response;
    } else {
      couplings_[i * m + place(j)] += response;
    }
  });
  free_rate_.resize(m);
  for (std::size_t f = 0; f < m; ++f) {
    const BodyConeProblem::Row& row = blocks.row(free_[f]);
    const double scale = places_[free_[f]].scale;
    if (row.softness != 0.0)
      values[eliminated_.slot(static_cast<int>(f), static_cast<int>(f))] +=
          scale * scale * row.softness;
    free_rate_[place(f)] = scale * row.rate;
  }
  factor();
  eliminated_.solve(free_rate_.data());
  solve_couplings();
  eliminate();
  return true;
}

// Factors A_FF, unless it is the one that is factored.
void RowElimination::factor() {
  if (matrix_ == factored_) return;
  factored_ = matrix_;
  eliminated_.values() = matrix_;
  eliminated_.factor(LeastNormSolver::kDependentPivot);
  known_couplings_.clear();
}

// Sets A_BF A_FF⁻¹. Rows that were solved with these factors are taken over: those of corrections
// are among those of velocities, in their order.
void RowElimination::solve_couplings() {
  const std::size_t m = free_.size(), n = bounded_.size();
  known_solved_.swap(solved_);
  solved_ = couplings_;
  std::size_t known = 0;
  for (std::size_t i = 0; i < n; ++i) {
    const double* const coupling = &couplings_[i * m];
    const auto is_known = [&](std::size_t at) {
      return std::equal(coupling, coupling + m, &known_couplings_[at]);
    };
    std::size_t at = known;
    while (at < known_couplings_.size() && !is_known(at)) at += m;
    if (at < known_couplings_.size()) {
      std::copy_n(&known_solved_[at], m, &solved_[i * m]);
      known = at + m;
    } else {
      eliminated_.solve(&solved_[i * m]);
    }
  }
}

// Sets Â and b̂.
void RowElimination::eliminate() {
  const std::size_t m = free_.size(), n = bounded_.size();
  b_.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    const double* const coupling = &couplings_[i * m];
    b_[i] = places_[bounded_[i]].scale * blocks_->row(bounded_[i]).rate;
    coupled_.clear();
    for (std::size_t f = 0; f < m; ++f)
      if (coupling[f] != 0.0) coupled_.push_back(f);
    for (const std::size_t f : coupled_) b_[i] -= coupling[f] * free_rate_[f];
    for (std::size_t j = 0; j <= i; ++j) {
      double& entry = A_[i * n + j];
      for (const std::size_t f : coupled_) entry -= coupling[f] * solved_[j * m + f];
      A_[j * n + i] = entry;
    }
  }
  for (std::size_t i = 0; i < n; ++i) {
    if (A_[i * n + i] > kHeldShare) continue;  // the diagonal is about 1 without free rows
    for (std::size_t j = 0; j < n; ++j) A_[i * n + j] = A_[j * n + i] = 0.0;
  }
}

void RowElimination::pick(const List<double>& p, List<double>* x) const {
  x->resize(size());
  for (std::size_t i = 0; i < size(); ++i) (*x)[i] = p[bounded_[i]] / places_[bounded_[i]].scale;
}

void RowElimination::expand(const List<double>& x, List<double>* p) const {
  const std::size_t m = free_.size();
  p->assign(blocks_->problem().rows.size(), 0.0);
  for (std::size_t i = 0; i < size(); ++i) (*p)[bounded_[i]] = places_[bounded_[i]].scale * x[i];
  for (std::size_t f = 0; f < m; ++f) {
    const std::size_t place = to_index(eliminated_.place(static_cast<int>(f)));
    double sum = free_rate_[place];
    for (std::size_t i = 0; i < size(); ++i) sum += solved_[i * m + place] * x[i];
    (*p)[free_[f]] = -places_[free_[f]].scale * sum;
  }
}

}  // namespace constraint_sim::engine
