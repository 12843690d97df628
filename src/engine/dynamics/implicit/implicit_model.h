#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>

#include "engine/dynamics/equations_of_motion.h"
#include "engine/math/list.h"
#include "engine/math/saddle_lu.h"

namespace constraint_sim::engine {

/// End of a link on a body or on a fixed point.
struct ImplicitEnd {
  std::size_t point = 0;
  int unknown = -1;  ///< first unknown of the body; -1: a fixed point
  int dofs = 0;      ///< 0, 3 or 6
  Eigen::Vector3d anchor;
  double sign = 0.0;  ///< -1 at end A, 1 at end B
};

/// Joint, spring or custom force of an island. A rod has g = ½(d·d − ℓ²) and force λ d, a ball
/// joint g = d and force λ. A spring has force λ d/‖d‖ (midpoint: d̄ over the mean of ‖d‖); g is its
/// law divided by its stiffness, so that no spring is too stiff. A general joint has the rows of
/// its kind.
struct ImplicitLink {
  enum class Kind { kRod, kBall, kGeneral, kSpring };
  Kind kind = Kind::kRod;
  std::size_t index = 0;  ///< index in EquationsOfMotion::links()
  std::array<ImplicitEnd, 2> ends;
  double stiffness = 0.0, damping = 0.0;
  int unknown = 0;  ///< index of its first row among the unknowns
  int rows = 1;
  bool is_between_points = false;
  JointKind joint{};
  std::array<Eigen::Matrix3d, 2> frames;               ///< body axes; general joints only
  double radius = 0.0;                                 ///< general joints only [m]
  std::array<std::uint8_t, kMaxJointRows> function{};  ///< index per row; soft rows last
  int rigid_rows = 1;
  std::size_t first_soft = 0;  ///< index in EquationsOfMotion::soft_coordinates()
  const CustomCode* custom = nullptr;
  bool has_custom_force = false;

  /// Index of a soft row in EquationsOfMotion::soft_coordinates().
  std::size_t soft_of(int row) const { return first_soft + to_index(row - rigid_rows); }
};

/// Row that couples two coordinates of general links.
struct ImplicitCoupling {
  struct Term {
    std::size_t link = 0;
    ScalarForm form;
    double ratio = 0.0;
  };
  std::array<Term, 2> terms;
  std::size_t row = 0;  ///< row number in EquationsOfMotion
  int unknown = 0;
  double metres = 1.0;
};

/// Bodies, links and couplings of an island, with the numbering of the unknowns of an ImplicitStep
/// and the order of their elimination. Unknowns are listed by body, from leaves to roots: Δx, w of
/// a rotating body, and λ of the rows that are assigned to the body.
class ImplicitModel {
 public:
  explicit ImplicitModel(const EquationsOfMotion& equations);

  std::size_t bodies() const { return mass_.size(); }
  std::size_t rotating() const { return inertia_.size(); }
  const List<ImplicitLink>& links() const { return links_; }
  const List<ImplicitCoupling>& couplings() const { return couplings_; }
  std::size_t first_unknown(std::size_t body) const { return to_index(first_unknown_[body]); }
  double mass(std::size_t body) const { return mass_[body]; }
  /// Principal moments of inertia of a rotating body.
  const Eigen::Vector3d& inertia(std::size_t body) const { return inertia_[body]; }
  double radius_of_gyration(std::size_t body) const { return radius_[body]; }
  /// Largest distance of an anchor from the centre of its rotating body, or radius of a joint [m].
  double extent() const { return extent_; }
  /// Whether rows may depend on each other: loops, or several links on a body.
  bool rows_may_depend() const { return may_depend_; }
  bool has_dampers() const { return has_dampers_; }
  /// Bodies and rows for SaddleLu::analyze().
  const List<SaddleLu::Node>& nodes() const { return nodes_; }
  const List<SaddleLu::Link>& blocks() const { return blocks_; }

  /// Diagonal entry of G M⁻¹ Gᵀ of a row with Jacobian J, with the mean principal inertia.
  double response(const ImplicitLink& link, const Jacobian& J) const;

 private:
  struct Forest;
  /// Links and coupled rows, listed by the body they are assigned to.
  struct RowsOfBodies {
    List<List<std::size_t>> links, coupled;
    bool have_loops;
  };
  void add_link(const EquationsOfMotion& equations, std::size_t l);
  Forest find_forest() const;
  RowsOfBodies share_rows(const Forest& forest) const;
  void make_nodes(const EquationsOfMotion& equations);
  void make_blocks(const Forest& forest, const RowsOfBodies& rows);

  List<ImplicitLink> links_;
  List<ImplicitCoupling> couplings_;
  List<int> first_unknown_;  // per body
  List<double> mass_;
  List<Eigen::Vector3d> inertia_;
  List<double> radius_;
  double extent_ = 0.0;
  bool may_depend_ = false, has_dampers_ = false;
  List<SaddleLu::Node> nodes_;
  List<SaddleLu::Link> blocks_;
};

}  // namespace constraint_sim::engine
