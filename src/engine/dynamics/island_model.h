#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <unordered_map>
#include <utility>

#include "constraint_sim/engine/body.h"
#include "engine/constraints/coupling.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/constraints/law.h"
#include "engine/constraints/prescribed.h"
#include "engine/math/list.h"
#include "engine/math/sparse_ldlt.h"
#include "engine/model/mass_properties.h"

namespace constraint_sim::engine {

/// Sign of ends A and B in a row's rate J_B v_B − J_A v_A.
inline constexpr std::array<double, 2> kEndSign{-1.0, 1.0};

/// Offsets of v, q and L in a state vector: x and v of all bodies, then q (x, y, z, w) and L of
/// rotating bodies. Even, so that no SIMD pair mixes two kinds of numbers.
struct StateLayout {
  std::size_t v_at = 0, q_at = 0, L_at = 0, size = 0;
};

/// Compiled structure of one island: which bodies rotate, the joints sorted by their kind of row,
/// and the rows with the bodies they act on. Constant but for follow_laws().
class IslandModel {
 public:
  /// Joint indices: rods first, those between centres before all others, then ball joints, general
  /// joints, springs.
  const List<int>& joints() const { return joints_; }
  /// Body indices; bodies whose rotation is part of the state come first.
  const List<int>& bodies() const { return bodies_; }
  std::size_t rotating() const { return rotating_; }
  std::size_t rows() const { return rows_.size(); }
  /// Whether the island is a chain of rods between centres. Joints and bodies are then in chain
  /// order.
  bool is_chain() const { return is_chain_; }
  /// Whether the island is a chain of rotating bodies on ball joints. Joints and bodies are then in
  /// chain order.
  bool is_chain_of_bodies() const { return is_chain_of_bodies_; }
  /// Whether the island is one body on one rod between centres.
  bool is_point_on_rod() const { return is_chain_ && links_.size() == 1 && bodies_.size() == 1; }

  /// Joint between two points. Points are numbered: bodies in the order of the state, then fixed
  /// points.
  struct Link {
    std::size_t a, b;
    Eigen::Vector3d anchor_a, anchor_b;
    bool has_arms;  ///< whether either end rotates
    double stiffness = 0.0, damping = 0.0;
    JointKind kind{};
    std::size_t first_row = 0;  ///< rigid joints only
    /// Number of rigid rows, and the index of each among the rows and coordinates of the kind.
    int rows = 1;
    std::array<std::uint8_t, kMaxJointRows> function{0, 1, 2, 3, 4, 5};
    std::size_t first_soft = 0, softs = 0;  ///< range in soft_coordinates(); general joints only
    Eigen::Matrix3d frame_a = Eigen::Matrix3d::Identity(), frame_b = frame_a;
    double radius = 0.0;                 ///< arm that converts row angles to lengths [m]
    const CustomCode* custom = nullptr;  ///< code of a custom kind, else null
    bool has_custom_force() const { return is_custom_force(kind); }
  };
  /// Scalar equation. `block_a`, `block_b`: indices into angular_blocks_, −1 where the end does not
  /// rotate.
  struct Row {
    std::size_t a, b;
    double inverse_mass = 0.0;  // sum over both ends [1/kg]
    int block_a = -1, block_b = -1;
  };
  /// Row of a general joint.
  struct GeneralRow {
    std::size_t row, link;
    ScalarForm form;
    double metres;  ///< metres per unit of the row
  };
  /// Coordinate with springs, dampers or forces along it, and without a motor that holds it.
  struct SoftCoordinate {
    std::size_t link;
    int function;  ///< index among the rows and coordinates of the kind
    ScalarForm form;
    SoftLaw law;
    double zero = 0.0;  ///< position where the form is zero, as in CoordinateLaw [m or rad]
  };
  /// Row Σ ratio q − constant of a joint that couples coordinates of general joints. Acts in two
  /// parts, one per term, each between the two bodies of the term's joint.
  struct CoupledRow {
    struct Term {
      std::size_t link;
      int coordinate;  ///< index of the coordinate in its joint
      ScalarForm form;
      double ratio;
      double zero = 0.0;     ///< as in SoftCoordinate
      std::size_t part = 0;  ///< number for part()
    };
    std::size_t link;  ///< link of the coupling joint
    std::size_t row;
    double metres;  ///< metres per unit of the row
    std::array<Term, 2> terms;
  };

  /// Row or part that turns a body.
  struct AngularBlock {
    std::size_t body, row;  ///< row: number for part()
  };
  /// Attachment point of a joint on an immovable body.
  struct FixedPoint {
    int body;
    Eigen::Vector3d anchor;
    bool has_axes;
  };

  /// Indices in links() of the first rod that turns a body, ball joint, general joint and spring.
  struct FirstLinks {
    std::size_t armed = 0, ball = 0, general = 0, spring = 0;
  };

  /// Links in the order of joints().
  const List<Link>& links() const { return links_; }
  bool is_rod(std::size_t l) const { return l < first_.ball; }
  bool is_ball(std::size_t l) const { return l >= first_.ball && l < first_.general; }
  /// Whether link l is neither rod, ball joint nor spring.
  bool is_general(std::size_t l) const { return l >= first_.general && l < first_.spring; }
  /// Row of a rod, or first row of another rigid joint.
  std::size_t row_of(std::size_t l) const { return links_[l].first_row; }
  /// Number of rows of a rigid joint.
  std::size_t rows_of(std::size_t l) const { return static_cast<std::size_t>(links_[l].rows); }
  /// Form of row k of general joint l.
  const ScalarForm& form(std::size_t l, std::size_t k) const {
    return forms(links_[l].kind).function[links_[l].function[k]];
  }
  const FirstLinks& first() const { return first_; }
  const StateLayout& layout() const { return layout_; }
  /// Rows of general joints, in row order.
  const List<GeneralRow>& general_rows() const { return general_rows_; }
  const List<SoftCoordinate>& soft_coordinates() const { return softs_; }
  const List<CoupledRow>& coupled_rows() const { return coupled_; }
  bool has_custom_forces() const { return has_custom_forces_; }
  /// Number of points: bodies and fixed points.
  std::size_t points() const { return inverse_mass_.size(); }
  double inverse_mass(std::size_t point) const { return inverse_mass_[point]; }
  const Eigen::Vector3d& inertia(std::size_t turning) const { return inertia_[turning]; }
  double radius_of_gyration(std::size_t turning) const { return radius_of_gyration_[turning]; }
  const List<AngularBlock>& angular_blocks() const { return angular_blocks_; }
  const List<FixedPoint>& fixed_points() const { return fixed_points_; }
  /// Whether a point is a body whose rotation is part of the state.
  bool rotates(std::size_t point) const { return point < rotating_; }
  /// Whether link l has rows of an offset: a ball joint or a general joint.
  bool is_by_offset(std::size_t l) const { return l >= first_.ball && l < first_.spring; }
  std::size_t first_coupled_row() const { return rows_.size() - coupled_.size(); }
  std::size_t first_general_row() const { return first_coupled_row() - general_rows_.size(); }
  /// Number of parts: all rows, then the second parts of coupled rows.
  std::size_t parts() const { return rows_.size() + parts_.size(); }
  const Row& part(std::size_t i) const {
    return i < rows_.size() ? rows_[i] : parts_[i - rows_.size()];
  }
  std::size_t row_of_part(std::size_t i) const {
    return i < rows_.size() ? i : first_coupled_row() + i - rows_.size();
  }

 protected:
  using Ends = List<std::pair<std::size_t, std::size_t>>;  // bodies A and B, per joint of the world

  /// Takes the arguments of the constructor of EquationsOfMotion.
  IslandModel(List<int> joints, const List<Joint>& all_joints, const Ends& ends,
              const List<MassProperties>& masses, const List<CoupledTerms>& couplings,
              const List<int>& idle, const List<char>& open);

  /// Described in EquationsOfMotion.
  bool follow_laws(const List<Joint>& all_joints);

  List<int> joints_;
  List<int> bodies_;
  std::size_t rotating_ = 0;
  List<Link> links_;
  FirstLinks first_;
  StateLayout layout_;
  List<Row> rows_;   // one per rod, three per ball joint, then general rows, then coupled rows
  List<Row> parts_;  // second parts of coupled rows
  List<GeneralRow> general_rows_;
  List<CoupledRow> coupled_;
  List<SoftCoordinate> softs_;
  List<AngularBlock> angular_blocks_;
  List<FixedPoint> fixed_points_;
  List<double> inverse_mass_;        // per point [1/kg]
  List<Eigen::Vector3d> inertia_;    // principal, per rotating body [kg m²]
  List<double> radius_of_gyration_;  // per rotating body [m]
  bool is_chain_ = false, is_chain_of_bodies_ = false;
  bool has_custom_forces_ = false;

 private:
  using Places = std::unordered_map<std::size_t, std::size_t>;  // place in bodies_, by movable body

  void find_bodies(const List<Joint>& all_joints, const Ends& ends,
                   const List<MassProperties>& masses, const List<int>& idle,
                   const List<char>& open);
  bool order_as_chain(const List<Joint>& all_joints, const Ends& ends,
                      const List<MassProperties>& masses);
  void turn_along_chain();
  void sort_joints(const List<Joint>& all_joints, const Ends& ends, const Places& places,
                   const List<char>& open);
  void add_links(const List<Joint>& all_joints, const Ends& ends,
                 const List<MassProperties>& masses, const Places& places);
  static void add_coordinates(const Joint& joint, std::size_t l, Link* link,
                              List<SoftCoordinate>* softs);
  void add_all_rows();
  Row new_row(const Link& link, std::size_t part);
  void add_coupled_rows(const List<Joint>& all_joints, const List<CoupledTerms>& couplings);
};

}  // namespace constraint_sim::engine
