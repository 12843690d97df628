// Loops of gears and pulleys: whether a new coupling contradicts the acting couplings.

#include "engine/edits/coupling_loops.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "engine/constraints/joint.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/math/list.h"
#include "engine/model/validate.h"

namespace constraint_sim::engine {
namespace {

constexpr double kLoopFits = 1e-6;  // error up to which a coupling fits a loop [unit of q₁]
constexpr double kParallel = 1e-9;  // a sum of ratios below this share of its terms is zero
// Margin for the rounding of the present errors, which are summed in another order.
constexpr double kSumRounding = 1.001;

/// A coordinate as a function of the root coordinate: q = share · q_root + constant. `off`:
/// bound of its present error, since couplings on the path to the root may still be closing.
struct Implied {
  double share = 1.0, constant = 0.0, off = 0.0;
};

/// An acting coupling q₁ + ratio q₂ = constant of the first coordinates of the joints `first` and
/// `second`, by index. `error`: its present error.
struct Acting {
  std::size_t joint, first, second;
  double ratio, constant, error;
};

/// All coordinates that couplings connect with a root coordinate, as functions of the root.
class CoupledCoordinates {
 public:
  CoupledCoordinates(std::size_t root, const List<Acting>& couplings) {
    std::map<std::size_t, List<std::size_t>> on;  // couplings, by the joints they couple
    for (std::size_t i = 0; i < couplings.size(); ++i)
      for (const std::size_t joint : {couplings[i].first, couplings[i].second})
        on[joint].push_back(i);
    // Pairs (pass, coupling) to follow. Repeated passes over all couplings, each following
    // couplings with a known coordinate, would have the same order; this queue skips idle
    // couplings.
    std::set<std::pair<std::size_t, std::size_t>> next;
    List<bool> is_followed(couplings.size());
    known_[root] = {};
    for (const std::size_t i : on[root]) next.emplace(0, i);
    while (!next.empty()) {
      const auto [pass, i] = *next.begin();
      next.erase(next.begin());
      if (is_followed[i]) continue;
      is_followed[i] = true;
      const Acting& coupling = couplings[i];
      List<std::size_t> reached;
      for (const std::size_t joint : {coupling.first, coupling.second})
        if (!leads_to(joint)) reached.push_back(joint);
      follow(coupling);
      for (const std::size_t joint : reached)
        for (const std::size_t k : on[joint])
          if (!is_followed[k]) next.emplace(k > i ? pass : pass + 1, k);
    }
  }

  bool leads_to(std::size_t joint) const { return known_.count(joint) > 0; }

  /// Returns q₁ + ratio q₂; empty where the sum depends on q_root and no loop determines q_root.
  std::optional<Implied> sum(std::size_t first, double ratio, std::size_t second) const {
    Implied all = by_root(first, ratio, second);
    if (all.share == 0.0) return all;
    if (!root_) return std::nullopt;
    all.constant += all.share * root_->constant;
    all.off += std::abs(all.share) * root_->off;
    return all;
  }

  /// Returns the couplings that determine q₁ + ratio q₂.
  std::set<std::size_t> reasons(std::size_t first, double ratio, std::size_t second) const {
    std::set<std::size_t> names;
    for (const std::size_t joint : {first, second}) add_couplings_to_root(joint, &names);
    if (by_root(first, ratio, second).share == 0.0 || !root_) return names;
    names.insert(loop_->joint);
    for (const std::size_t joint : {loop_->first, loop_->second})
      add_couplings_to_root(joint, &names);
    return names;
  }

 private:
  struct Known {
    Implied q{};
    std::optional<Acting> by{};  ///< coupling that determines q; empty for the root
  };

  Implied by_root(std::size_t first, double ratio, std::size_t second) const {
    const Implied &a = known_.at(first).q, &b = known_.at(second).q;
    Implied all{a.share + ratio * b.share, a.constant + ratio * b.constant,
                a.off + std::abs(ratio) * b.off};
    const double terms = std::abs(a.share) + std::abs(ratio * b.share);
    if (std::abs(all.share) <= kParallel * terms) all.share = 0.0;
    return all;
  }

  /// Follows a coupling with one or two known coordinates.
  void follow(const Acting& coupling) {
    const bool has_first = leads_to(coupling.first), has_second = leads_to(coupling.second);
    const double ratio = coupling.ratio, constant = coupling.constant;
    if (has_first && has_second) {
      const Implied all = by_root(coupling.first, ratio, coupling.second);
      if (all.share == 0.0 || root_) return;
      root_ = Implied{0.0, (constant - all.constant) / all.share,
                      (all.off + coupling.error) / std::abs(all.share)};
      loop_ = coupling;
    } else if (has_first) {
      const Implied q = known_.at(coupling.first).q;
      known_[coupling.second] = {{-q.share / ratio, (constant - q.constant) / ratio,
                                  (q.off + coupling.error) / std::abs(ratio)},
                                 coupling};
    } else {
      const Implied q = known_.at(coupling.second).q;
      known_[coupling.first] = {{-ratio * q.share, constant - ratio * q.constant,
                                 std::abs(ratio) * q.off + coupling.error},
                                coupling};
    }
  }

  void add_couplings_to_root(std::size_t joint, std::set<std::size_t>* names) const {
    for (const Known* known = &known_.at(joint); known->by; known = &known_.at(joint)) {
      names->insert(known->by->joint);
      joint = known->by->first == joint ? known->by->second : known->by->first;
    }
  }

  std::map<std::size_t, Known> known_;
  std::optional<Implied> root_;  // value of q_root, if a loop (loop_) determines it
  std::optional<Acting> loop_;
};

}  // namespace

void check_coupling_loop(const Model& model, const State& state, const Joint& joint) {
  const std::size_t first = model.index(joint.coupling.first);
  const std::size_t second = model.index(joint.coupling.second);
  List<Acting> couplings;
  bool has_first = false, has_second = false;
  for (std::size_t j = 0; j < model.joints.size(); ++j) {
    if (!info(model.joints[j].kind).couples_joints ||
        !acts(model.joints[j], state.joint_states[j]) || model.joints[j].coupling.one_sided)
      continue;
    const CoupledTerms terms = model.terms_of(j);
    const CouplingState& now = state.joint_states[j].coupling;
    couplings.push_back({j, terms[0].joint, terms[1].joint, terms[1].ratio, now.constant,
                         std::abs(now.value - now.constant)});
    for (const CoupledTerm& term : terms) {
      has_first = has_first || term.joint == first;
      has_second = has_second || term.joint == second;
    }
  }
  if (!has_first || !has_second) return;
  const CoupledCoordinates coordinates(first, couplings);
  if (!coordinates.leads_to(second)) return;
  const double ratio = joint.coupling.ratio;
  const std::optional<Implied> implied = coordinates.sum(first, ratio, second);
  if (!implied) return;
  const auto reads = [&](std::size_t j) { return state.joint_states[j].coordinates[0].position; };
  const double value = joint.coupling.value.value_or(reads(first) + ratio * reads(second));
  const double over = implied->constant - value;
  if ((joint.coupling.one_sided ? over : std::abs(over)) <= kLoopFits + kSumRounding * implied->off)
    return;
  std::string names;
  for (const std::size_t j : coordinates.reasons(first, ratio, second))
    names += (names.empty() ? "" : ", ") + in_quotes(model.joints[j].name);
  refuse("value", "contradicts " + names + ", by which it is " + shortest(implied->constant) +
                      ", got " + shortest(value));
}

}  // namespace constraint_sim::engine
