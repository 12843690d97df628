#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstddef>

#include "engine/dynamics/equations_of_motion.h"
#include "engine/math/list.h"
#include "engine/math/sparse_ldlt.h"

namespace constraint_sim::engine {

/// Positions of all points of an EquationsOfMotion, fixed points last, and orientations of its
/// rotating bodies.
struct Configuration {
  List<Eigen::Vector3d> position;
  List<Eigen::Quaterniond> orientation;
  List<Eigen::Matrix3d> fixed_axes;  ///< per fixed point
  /// Frames on B, one per joint, where joint frames move; else empty.
  List<MovingFrame> frames_b;
};

/// Velocity, displacement or impulse per body: linear for all bodies, angular for rotating bodies.
struct BodyVectors {
  List<Eigen::Vector3d> linear, angular;
};

/// The Jacobian G of all joints of an island, springs included, and the factors of
/// A = G M⁻¹ Gᵀ + diagonal. Every row is kept, whether or not the row depends on others: the
/// diagonal makes A regular. Directions are unit vectors, so that a row measures metres.
class RegularizedRows {
 public:
  explicit RegularizedRows(const EquationsOfMotion& equations);

  struct Row {
    std::size_t joint = 0;  ///< index in EquationsOfMotion::joints()
    int index = 0;          ///< index among the rows of the joint
    int axis = -1;  ///< world axis of a ball joint; -1: along the vector between the anchors
    bool is_spring = false;
    bool is_general = false;  ///< row of a general joint: `form` times `metres`
    ScalarForm form;
    /// Index in EquationsOfMotion::soft_coordinates() of a spring along a coordinate; -1: none.
    int soft = -1;
    double metres = 1.0;  ///< metres per unit of the row
    int coupled = -1;     ///< index in EquationsOfMotion::coupled_rows(); -1: row of a single joint
    SparseLdlt::Slot diagonal = 0;
    Eigen::Vector3d direction = Eigen::Vector3d::UnitX();
    std::array<Eigen::Vector3d, 2> angular, response;  ///< per end A, B: J_ang, I⁻¹ J_angᵀ
  };
  const List<Row>& rows() const { return rows_; }
  std::size_t first_row(std::size_t joint) const { return first_row_[joint]; }

  /// Vector from anchor A to anchor B of a joint, and the arms at which its forces act, in world
  /// axes [m]. Arms of a ball joint between two bodies meet halfway, so that its forces have no
  /// moment where the joint is off.
  struct JointGeometry {
    Eigen::Vector3d d;
    std::array<Eigen::Vector3d, 2> arm;
    std::array<Eigen::Matrix3d, 2> axes;  ///< general joints only
    const CustomCode* custom = nullptr;

    JointVectors vectors() const { return {arm, d, axes, custom}; }
  };
  using Geometry = List<JointGeometry>;
  void measure(const Configuration& configuration, Geometry* geometry) const;
  /// Whether neither end of the joint is a fixed point.
  bool is_between_bodies(std::size_t joint) const {
    return joints_[joint].a < bodies_ && joints_[joint].b < bodies_;
  }

  /// Evaluates the Jacobian at the mean of two geometries, or at one geometry given twice. The
  /// direction of a distance is the mean of both vectors over the mean of their lengths, so that
  /// its product with the change of the vector is the change of the length (Gonzalez, J. Nonlinear
  /// Sci. 6 (1996)).
  void linearize(const Geometry& a, const Geometry& b, const Configuration& inertia);

  /// Computes the diagonal entries of G M⁻¹ Gᵀ; ball joints get the mean of their three, so that no
  /// axis is preferred.
  void find_weights(List<double>* weights) const;
  /// Factors A with `share` times the weight added to rigid rows, and `compliance` (by row) added
  /// to spring rows. Without `compliance` springs do not act.
  void factor(double share, const List<double>& weights, const List<double>* compliance);
  /// Replaces b, by row, by A⁻¹ b.
  void solve(List<double>* b);

  /// Returns G u of one row. Immovable points count where `u` has entries for them.
  double apply(const Row& row, const BodyVectors& u) const;
  /// Adds M⁻¹ Gᵀ λ to u.
  void add_response(const List<double>& lambda, BodyVectors* u) const;
  /// Replaces u by Gᵀ λ.
  void apply_transpose(const List<double>& lambda, BodyVectors* u) const;

 private:
  /// Part i: a row of rows_, or the second term of a coupling in parts_.
  const Row& part(std::size_t i) const {
    return i < rows_.size() ? rows_[i] : parts_[i - rows_.size()];
  }
  std::size_t row_of_part(std::size_t i) const { return i < rows_.size() ? i : i - parts_.size(); }
  void add_coupled(const EquationsOfMotion& equations);
  /// Two parts on one body, or one part twice.
  struct Coupling {
    std::size_t i, j, end_i, end_j, body;
    SparseLdlt::Slot slot;
  };

  void linearize(const JointVectors& a, const JointVectors& b,
                 const List<Eigen::Matrix3d>& inverse_inertia, Row* row) const;
  double product(const Coupling& c) const;

  List<EquationsOfMotion::Link> joints_;
  std::size_t bodies_, rotating_;
  List<double> inverse_mass_;
  List<Eigen::Vector3d> inertia_;
  List<Row> rows_;   // coupled rows last
  List<Row> parts_;  // second parts of coupled rows
  List<std::size_t> first_row_;
  List<Coupling> couplings_;
  SparseLdlt ldlt_;
  List<double> permuted_;
};

}  // namespace constraint_sim::engine
