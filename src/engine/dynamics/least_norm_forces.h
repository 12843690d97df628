#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>

#include "constraint_sim/engine/body.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/math/list.h"
#include "engine/math/sparse_ldlt.h"

namespace constraint_sim::engine {

/// Reported impulses of an island with redundant rows. The motion determines only their sum on each
/// body, and many λ have that sum. The reported λ has the least Σ a λ² over all rigid rows, with a
/// the diagonal entry of G M⁻¹ Gᵀ, for a ball joint the mean of its three:
///   λ = D⁻¹ G z,  Gᵀ D⁻¹ G z = Gᵀ λ of the motion,  D = diag(a)
/// Equal joints get equal shares. The motion is not affected.
class LeastNormForces {
 public:
  explicit LeastNormForces(const EquationsOfMotion& equations);

  /// Distributes the impulses of `equations` over the rows at the pose where the step ends. Keeps
  /// the impulses where no others of equal sum are found, as at mass ratios above 1e10.
  void share(const EquationsOfMotion& equations, const List<BodyState>& states);
  /// Impulse of joints()[l], laid out as JointForces::impulse().
  RowVector impulse(const EquationsOfMotion& equations, std::size_t l) const;
  double coupled_impulse(const EquationsOfMotion& equations, std::size_t l) const;

 private:
  /// Rigid joint; its slots hold the lower triangle of the unknowns of its bodies.
  struct Link {
    int rows;
    std::array<int, 2> unknown;  // first unknown of each end's body; -1: a fixed point
    std::array<std::size_t, 2> unknowns;
    std::size_t first_row, first_slot;
  };
  /// Force and torque of a unit impulse of a row on its ends A and B.
  using Row = std::array<double, 12>;

  /// Coupling row on up to four bodies.
  struct CoupledRow {
    struct End {
      int unknown;
      std::size_t unknowns, point;
      std::array<double, 6> row;
    };
    List<End> ends;
    std::size_t first_slot = 0;
    double inverse_weight = 0.0, impulse = 0.0, share = 0.0;
  };

  void add_coupled(const EquationsOfMotion& equations, List<std::pair<int, int>>* pattern);
  template <class Visit>
  static void for_each_entry(const CoupledRow& coupled, Visit visit);
  void place(const EquationsOfMotion& equations, const List<BodyState>& states);
  void place_coupled(const EquationsOfMotion& equations, const List<BodyState>& states);
  JointVectors place_ends(const EquationsOfMotion& equations, const List<BodyState>& states,
                          std::size_t l, std::array<Eigen::Vector3d, 2>* arm,
                          Eigen::Vector3d* d) const;
  JointVectors vectors_of(const EquationsOfMotion& equations, const List<BodyState>& states,
                          std::size_t l, const std::array<Eigen::Vector3d, 2>& arm,
                          const Eigen::Vector3d& d) const;
  void factor();
  void gather_state(const EquationsOfMotion& equations);
  void find_shares();
  double find_missing();
  void add_shares();
  bool has_same_sum() const;
  template <class Visit>
  void for_each_entry(const Link& link, Visit visit) const;

  List<Link> links_;  // rigid joints, in the order of joints()
  List<Row> rows_;
  List<CoupledRow> coupled_;      // order of EquationsOfMotion::coupled_rows()
  List<double> inverse_weights_;  // 1/a per row
  List<SparseLdlt::Slot> slots_, diagonal_;
  SparseLdlt ldlt_;         // factors of Gᵀ D⁻¹ G
  List<double> stiffness_;  // diagonal of Gᵀ D⁻¹ G
  List<double> missing_;    // Gᵀ of the impulses not distributed yet, then z; by unknown
  List<double> permuted_;   // missing_ in the order of the elimination
  List<char> is_torque_;    // whether an unknown is a rotation
  List<double> impulses_;   // impulses of the motion: rows, then springs [N s]
  List<double> shares_;     // reported, in the order of impulses_ [N s]
};

}  // namespace constraint_sim::engine
