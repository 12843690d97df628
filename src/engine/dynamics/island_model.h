#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <unordered_map>
#include <utility>

#include "constraint_sim/engine/body.h"
#include "engine/constraints/coupling.h"
#include "engine/constraints/course.h"
#include "engine/constraints/joint.h"
#include "engine/constraints/joint_kinds.h"
#include "engine/constraints/law.h"
#include "engine/math/list.h"
#include "engine/math/sparse_ldlt.h"
#include "engine/model/mass_properties.h"

namespace constraint_sim::engine {

/// Sign of ends A and B in a row's rate J_B v_B − J_A v_A.
inline constexpr std::array<double, 2> kEndSign{-1.0, 1.0};

/// What the bodies and joints of one island are compiled to: which bodies turn, the joints in an
/// order by what they need, and their rows with the bodies these act on. Only the constructor
/// allocates. EquationsOfMotion are such a model with what moves.
class IslandModel {
 public:
  /// Rods first, those between centres before all others, then ball joints, general ones, springs.
  const List<int>& joints() const { return joints_; }
  /// Those whose rotation is part of the state first.
  const List<int>& bodies() const { return bodies_; }
  std::size_t rotating() const { return rotating_; }
  std::size_t rows() const { return rows_.size(); }
  /// Rods between centres alone, one after the other; joints and bodies are then in this order.
  bool is_chain() const { return is_chain_; }
  /// The same of bodies that turn, on ball joints alone.
  bool is_chain_of_bodies() const { return is_chain_of_bodies_; }
  /// One rod between centres with one body.
  bool is_point_on_rod() const { return is_chain_ && links_.size() == 1 && bodies_.size() == 1; }

  /// A joint between two points: bodies in the order of the state, then fixed points.
  struct Link {
    std::size_t a, b;
    Eigen::Vector3d anchor_a, anchor_b;
    bool has_arms;  ///< either end turns
    double stiffness = 0.0, damping = 0.0;
    JointKind kind{};
    std::size_t first_row = 0;  ///< of general ones
    /// Its rigid rows, among the rows and coordinates of its kind.
    int rows = 1;
    std::array<std::uint8_t, kMaxJointRows> function{0, 1, 2, 3, 4, 5};
    std::size_t first_soft = 0, softs = 0;  ///< of general ones, in soft_coordinates()
    Eigen::Matrix3d frame_a = Eigen::Matrix3d::Identity(), frame_b = frame_a;
    double radius = 0.0;                 ///< [m] that turns the angles of its rows into lengths
    const CustomCode* custom = nullptr;  ///< of kinds that are custom
    bool has_custom_force() const { return is_custom_force(kind); }
  };
  /// One scalar equation; `block_a`, `block_b` into angular_blocks_, -1 where the end does not
  /// turn.
  struct Row {
    std::size_t a, b;
    std::size_t unknown = 0;    // where its λ stands in a solution
    double inverse_mass = 0.0;  // of both ends
    int block_a = -1, block_b = -1;
  };
  /// A row of a general joint.
  struct GeneralRow {
    std::size_t row, link;
    ScalarForm form;
    double metres;  ///< of a unit of the row
  };
  /// A coordinate that springs, dampers or forces act along, and no motor holds.
  struct SoftCoordinate {
    std::size_t link;
    int function;  ///< among the rows and coordinates of its kind
    ScalarForm form;
    SoftLaw law;
    double zero = 0.0, position = 0.0;  ///< as CoordinateState has them; of angles near enough
    double rate = 0.0;                  ///< then [rad/s], so that angles go on from there
  };
  /// The row Σ ratio q − constant of a joint that couples coordinates of general ones. It acts in
  /// two parts, one a term, each between the two bodies of that joint.
  struct CoupledRow {
    struct Term {
      std::size_t link;
      int coordinate;  ///< of its joint
      ScalarForm form;
      double ratio;
      double zero = 0.0, position = 0.0, rate = 0.0;  ///< as SoftCoordinate has them
      std::size_t part = 0;                           ///< as part() has it
    };
    std::size_t link;  ///< whose it is
    std::size_t row;
    double metres;  ///< of a unit of the row
    std::array<Term, 2> terms;
    double constant = 0.0;
    Prescribed closing;  ///< what the row is to be off by
  };

  /// As joints().
  const List<Link>& links() const { return links_; }
  bool is_rod(std::size_t l) const { return l < first_ball_; }
  bool is_ball(std::size_t l) const { return l >= first_ball_ && l < first_general_; }
  /// Neither of these nor a spring.
  bool is_general(std::size_t l) const { return l >= first_general_ && l < first_spring_; }
  /// Of a rod, or the first of another joint.
  std::size_t row_of(std::size_t l) const { return is_rod(l) ? l : first_row(l); }
  /// Rows of a rigid joint.
  std::size_t rows_of(std::size_t l) const { return static_cast<std::size_t>(links_[l].rows); }
  /// Of one of these.
  const ScalarForm& form(std::size_t l, std::size_t k) const {
    return info(links_[l].kind).function[links_[l].function[k]];
  }
  /// The first of the general ones.
  std::size_t first_general() const { return first_general_; }
  /// Of general joints, as rows are.
  const List<GeneralRow>& general_rows() const { return general_rows_; }
  const GeneralRow& general_row(std::size_t row) const {
    return general_rows_[row - first_general_row()];
  }
  const List<SoftCoordinate>& soft_coordinates() const { return softs_; }
  const List<CoupledRow>& coupled_rows() const { return coupled_; }
  bool has_custom_forces() const { return has_custom_forces_; }
  /// Bodies and fixed points.
  std::size_t points() const { return inverse_mass_.size(); }
  double inverse_mass(std::size_t point) const { return inverse_mass_[point]; }
  const Eigen::Vector3d& inertia(std::size_t turning) const { return inertia_[turning]; }
  double radius_of_gyration(std::size_t turning) const { return radius_of_gyration_[turning]; }

 protected:
  using Ends = List<std::pair<std::size_t, std::size_t>>;  // of all joints: bodies

  /// As the constructor of EquationsOfMotion.
  IslandModel(List<int> joints, const List<Joint>& all_joints, const Ends& ends,
              const List<MassProperties>& masses, const List<CoupledTerms>& couplings,
              const List<int>& idle, const List<char>& open);

  /// Where a row or part turns a body.
  struct AngularBlock {
    std::size_t body, row, unknown;
  };
  /// A place of an immovable body that a joint holds on to.
  struct FixedPoint {
    int body;
    Eigen::Vector3d anchor;
    bool has_axes;
    BodyState start;  // of the body at the start of the tick
    // against the body, while the frame of a joint moves
    Eigen::Vector3d anchor_rate = Eigen::Vector3d::Zero();
    Eigen::Vector3d anchor_acceleration = Eigen::Vector3d::Zero();
  };

  bool rotates(std::size_t point) const { return point < rotating_; }
  bool is_by_offset(std::size_t l) const { return l >= first_ball_ && l < first_spring_; }
  std::size_t first_row(std::size_t l) const {
    return is_ball(l) ? first_ball_ + 3 * (l - first_ball_) : links_[l].first_row;
  }
  std::size_t first_coupled_row() const { return rows_.size() - coupled_.size(); }
  std::size_t first_general_row() const { return first_coupled_row() - general_rows_.size(); }
  /// Rows, and then the second parts of coupled ones, are parts.
  std::size_t parts() const { return rows_.size() + parts_.size(); }
  const Row& part(std::size_t i) const {
    return i < rows_.size() ? rows_[i] : parts_[i - rows_.size()];
  }
  std::size_t row_of_part(std::size_t i) const {
    return i < rows_.size() ? i : first_coupled_row() + i - rows_.size();
  }

  List<int> joints_;
  List<int> bodies_;
  std::size_t rotating_ = 0;
  List<Link> links_;
  std::size_t first_armed_ = 0, first_ball_ = 0, first_general_ = 0, first_spring_ = 0;  // links_
  List<Row> rows_;   // of rods one each, of ball joints three, then of general ones, coupled
  List<Row> parts_;  // second ones of coupled rows
  List<GeneralRow> general_rows_;
  List<CoupledRow> coupled_;
  List<SoftCoordinate> softs_;
  List<AngularBlock> angular_blocks_;
  List<FixedPoint> fixed_points_;
  List<double> inverse_mass_;        // of points
  List<Eigen::Vector3d> inertia_;    // of those that turn
  List<double> radius_of_gyration_;  // of those that turn
  bool is_chain_ = false, is_chain_of_bodies_ = false;
  bool has_custom_forces_ = false;

 private:
  using Places = std::unordered_map<std::size_t, std::size_t>;  // of movable bodies in bodies_

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
  void add_coordinates(const Joint& joint, Link* link);
  void add_all_rows();
  void add_rows(const Link& link, int count);
  Row new_row(const Link& link, std::size_t part);
  void add_coupled_rows(const List<Joint>& all_joints, const List<CoupledTerms>& couplings);
};

}  // namespace constraint_sim::engine
