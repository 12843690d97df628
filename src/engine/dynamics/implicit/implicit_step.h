#pragma once

#include <cmath>
#include <utility>

#include "constraint_sim/engine/body.h"
#include "engine/dynamics/endpoint_estimate.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/dynamics/implicit/couplings_in_step.h"
#include "engine/dynamics/implicit/implicit_model.h"
#include "engine/dynamics/implicit/implicit_motion.h"
#include "engine/dynamics/implicit/implicit_system.h"
#include "engine/dynamics/implicit/link_in_step.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// One step of an island as a system of equations for Newton's method. Unknowns: Δx of each body,
/// w of each rotating body with R₁ = cay(w) R₀, and λ of each row.
///   r_x = m (Δx − p) − s f
///   r_w = (1 + ½ŵ) J₀ (w − a) − (1 − ½ŵ)(b + s T),  J₀ = R₀ I R₀ᵀ
///   g = 0 at the end of the step
/// Forces f and torques T are taken at the means d̄, r̄ of both ends (midpoint) or at the end
/// (BDF2). An arm r changes by w × r̄ exactly. ImplicitRule lists s, p, a and b.
///
/// ImplicitModel numbers the unknowns. ImplicitMotion has r_x and r_w without links; point_links.h,
/// general_links.h and CouplingsInStep add g, f and T of the links, whose state in the step is
/// LinkInStep. FormInStep is a row with its derivatives. All of them write to ImplicitSystem, which
/// solves.
class ImplicitStep {
 public:
  // Defined in the .cpp file: copies of so many fields are compiled once.
  ImplicitStep(const ImplicitStep& other);
  ImplicitStep(ImplicitStep&& other) noexcept;
  ImplicitStep& operator=(const ImplicitStep& other);
  ImplicitStep& operator=(ImplicitStep&& other) noexcept;
  ~ImplicitStep();

  explicit ImplicitStep(const EquationsOfMotion& equations);

  std::size_t size() const { return system_.size(); }
  bool has_dampers() const { return model_.has_dampers(); }

  // ---- state at the start of the step
  void gather_state(const List<BodyState>& states, const EquationsOfMotion& equations);
  const ImplicitMotion& motion() const { return motion_; }
  /// Writes the points of all bodies at the current state.
  void write_points(Points* points) const { motion_.write_points(model_, points); }

  // ---- one step

  /// Per body: Δx, w of a rotating body, then λ of the rows assigned to the body; absent forces are
  /// zero.
  using Unknowns = List<double>;

  /// Begins a step from time t to t + h [s], h of either sign; `equations` provide the loads. BDF2
  /// continues from a finish() with the same h, by either rule, and an unchanged state. Returns
  /// false where the previous step has to be repeated with a shorter one.
  bool begin(double t, double h, ImplicitRule rule, EquationsOfMotion* equations);
  /// Evaluates the residual and its derivative at `unknowns`.
  void evaluate(const Unknowns& unknowns);
  /// Equations at the last evaluate().
  ImplicitSystem& system() { return system_; }
  /// Adds a scaled change, which system() has solved for, to the unknowns. Returns the largest
  /// displacement of a point [m].
  double add(const double* change, Unknowns* unknowns) const {
    return system_.add(model_, change, unknowns);
  }
  /// Removes or restores the force of momentary rows. With a force energy is kept: the mean
  /// Jacobian over the step has a direction where the Jacobian at its start has none.
  void leave_out_momentary_rows(bool are_out, const EquationsOfMotion& equations);
  /// Whether redundant rows are met at the current pose. Makes unmet rows ordinary rows again.
  bool redundant_rows_are_met(double t, EquationsOfMotion* equations) const {
    return equations->redundant_rows_are_met(t, motion_.positions(), motion_.orientations());
  }
  /// Makes the end of the step the current state and adds the impulses of the step to `equations`.
  void finish(const Unknowns& unknowns, EquationsOfMotion* equations);

  /// Largest frequency ω of the bodies under the forces of the last step [rad/s].
  double frequency() const { return frequency_; }
  /// Frequency ω of one body, in the order of EquationsOfMotion [rad/s].
  double frequency_of(std::size_t body) const { return std::sqrt(squares_[body]); }
  /// Resets the frequencies to zero.
  void forget();
  /// Visits all state that outlives an interval, except the bodies, as engine/support/memory.h
  /// describes. `with_step_before`: includes what BDF2 needs of the previous step.
  template <class Self, class Visit>
  static void visit_memory(Self& self, Visit& visit, bool with_step_before) {
    visit(self.squares_);
    visit(self.frequency_);
    if (!with_step_before) return;
    ImplicitMotion::visit_memory(self.motion_, visit);
    for (auto& link : self.links_) visit(link.before);
    for (auto& soft : self.softs_) visit(soft.start);
  }
  /// Largest spin [rad/s], and largest spin times radius of gyration [m/s], of rotating bodies with
  /// a frequency up to `most_frequency` [rad/s].
  std::pair<double, double> largest_spin(double most_frequency) const;
  /// Largest coordinate or length [m].
  double scale() const { return scale_; }
  /// Largest length, or distance from one body to the others, independent of the scene's origin
  /// [m].
  double extent() const { return extent_; }

 private:
  bool leave_out_dependent(double t, EquationsOfMotion* equations);
  void find_sizes(const EquationsOfMotion& equations);
  void add_impulses(const Unknowns& unknowns, EquationsOfMotion* equations) const;
  void find_frequencies(const Unknowns& unknowns);
  double force_of(const ImplicitLink& link, const Unknowns& unknowns) const;

  ImplicitModel model_;
  ImplicitMotion motion_;
  ImplicitSystem system_;
  List<LinkInStep> links_;
  List<SoftInStep> softs_;
  CouplingsInStep couplings_;
  List<char> is_dependent_;  // per row, see EquationsOfMotion::find_dependent()
  List<double> squares_;     // ω² per body
  double frequency_ = 0.0;
  double scale_ = 1.0, extent_ = 1.0;
};

}  // namespace constraint_sim::engine
