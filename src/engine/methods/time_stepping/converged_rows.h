#pragma once

#include <cstddef>

#include "constraint_sim/engine/stop_flag.h"
#include "engine/constraints/row.h"
#include "engine/impulses/row_solver.h"
#include "engine/math/body_cone_solver.h"
#include "engine/math/list.h"
#include "engine/model/mass_properties.h"

namespace constraint_sim::engine {

/// Solves the rows of time_stepping to a tolerance, in place of the sweeps of RowSolver: velocities
/// with Coulomb's cone, then the corrections, each for every component of bodies that rows connect.
/// Components of more than 500 bodies are swept. Between steps the fields are scratch memory.
class ConvergedRows {
 public:
  struct Outcome {
    double residual = 0.0;   ///< largest residual of a component [m/s]
    int iterations = 0;      ///< most iterations of a component
    double solved = 0.0;     ///< largest residual with which a component counts as solved [m/s]
    int unsolved = -1;       ///< a body of the first component that was not solved; -1: all were
    bool has_swept = false;  ///< whether a component was too large to be solved

    /// Adds the outcome of other components or rows.
    void add(const Outcome& other);
  };
  struct Accuracy {
    double rest_speed;  ///< speed that counts as rest [m/s]
    int sweeps;         ///< number of sweeps over a component that is too large to be solved
    /// Whether contacts in motion are solved as far as contacts at rest: loads of redundant
    /// contacts are unique then.
    bool is_unique;
  };

  /// Solves `rows` and leaves the impulses in them and the velocities in `solver`. Components that
  /// are swept have their corrections too.
  Outcome solve(const List<BodyState>& bodies, const List<MassProperties>& masses,
                const Accuracy& accuracy, StopFlag stop, List<Row>* rows, RowSolver* solver);
  /// How the corrections of a component are solved for.
  enum class Start : char {
    kKept,   ///< not at all
    kFirst,  ///< the first time in the step
    kAgain,  ///< from present corrections; redundant rows share the change as it comes
    kAnew,   ///< from none, where corrections of the last time are of no use
  };
  /// Solves for the corrections of the rows that solve() has not swept, after solve(). `starts`:
  /// per component, at the body of a component.
  void correct(const List<BodyState>& bodies, const List<MassProperties>& masses, double rest_speed,
               const List<Start>& starts, StopFlag stop, List<Row>* rows, RowSolver* solver);
  /// Outcome of the corrections of all components; of each, the last one counts.
  Outcome corrected() const;

  /// Whether solve() has swept the component that is stored at a body.
  bool is_swept(int component) const { return is_swept_[to_index(component)] != 0; }

  /// Finds the share of ½ (v₀ + v₁) in the motion of each body; v₁ has the rest. ½ h (v₀ + v₁) is
  /// exact for constant forces. The energy of a component changes in proportion to the shares.
  /// Bodies have the largest share in [0, 1] that adds no energy, and 0 on joints, in swept
  /// components, and with an impact whose mean velocity still approaches. Bodies that leave an
  /// impact as fast as they came have the least share that keeps the energy. Approaches above 1000
  /// `rest_speed` [m/s] are impacts; slower ones count as contacts at rest. `joints_by_mean`:
  /// bodies on joints move like bodies in contact.
  void find_mean_shares(const List<int>& moved, const List<Row>& rows, double rest_speed,
                        bool joints_by_mean, RowSolver* solver);
  /// Allows each component the gain of energy by v₁ that the shares give back.
  void allow_gains(const List<int>& moved, const List<Row>& rows, double rest_speed,
                   bool joints_by_mean, RowSolver* solver);
  double mean_share(std::size_t body) const { return shares_[body]; }

 private:
  /// Velocity by which a body moves: the mean, as far as it adds no energy; v₁, or the mean where
  /// v₁ adds energy; always v₁.
  enum class Motion : char { kMean, kImpact, kEnd };
  /// Changes of a component's energy by full shares of its kMean and of its kImpact bodies [J].
  struct Gains {
    double mean = 0.0, impact = 0.0;
  };

  void find_gains(const List<int>& moved, const List<Row>& rows, double rest_speed,
                  bool joints_by_mean, RowSolver* solver);
  bool carry_motions(const List<Row>& rows, double rest_speed, bool joints_by_mean,
                     const RowSolver& solver);
  void list_by_component(const List<Row>& rows, const RowSolver& solver);
  void add_parts(const Row& row, const List<BodyState>& bodies, const List<MassProperties>& masses);
  void add_part(int body, const Twist& J, const List<BodyState>& bodies,
                const List<MassProperties>& masses);
  void set_velocity_problem(std::size_t begin, std::size_t end, const List<BodyState>& bodies,
                            const List<MassProperties>& masses, const List<Row>& rows,
                            const RowSolver& solver);
  double largest_rate(std::size_t begin, std::size_t end, const List<Row>& rows,
                      const RowSolver& solver) const;
  bool set_correction_problem(std::size_t begin, std::size_t end, const List<BodyState>& bodies,
                              const List<MassProperties>& masses, bool is_anew,
                              const List<Row>& rows, const RowSolver& solver);
  void forget_bodies();
  void add(const BodyConeSolver::Outcome& solved, Outcome* outcome) const;

  List<std::size_t> order_;  // rows, by component
  List<std::size_t> begins_;
  List<std::size_t> swept_;         // rows of components that are too large
  List<char> is_swept_;             // at the body of a component
  List<double> loose_;              // BodyConeSolver::Goal::loose, per component of begins_
  List<Outcome> corrected_;         // per component of begins_
  List<std::size_t> problem_rows_;  // rows of the problem
  List<int> local_of_, bodies_;     // index in the problem of each body, and the reverse
  BodyConeProblem problem_;
  List<BodyConeSolver> solvers_;  // one for each component, for its order of elimination
  List<double> impulses_;
  List<Twist> by_guesses_;  // velocities by the first guesses, of the bodies of the problem
  List<double> shares_;     // share of the mean velocity, by body
  List<Motion> motions_;    // by body
  List<Gains> gains_;       // by component
};

}  // namespace constraint_sim::engine
