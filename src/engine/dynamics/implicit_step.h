#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <utility>

#include "constraint_sim/engine/body.h"
#include "engine/dynamics/endpoint_estimate.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/math/larger.h"
#include "engine/math/list.h"
#include "engine/math/saddle_lu.h"

namespace constraint_sim::engine {

/// Integration rule of a step, with its coefficients in the equations of ImplicitStep.
enum class ImplicitRule {
  /// Midpoint rule. Keeps rods, energy and momentum to rounding at any step size, even where the
  /// motion is too fast to be resolved: Simo & Wong, IJNME 31 (1991) 19; Gonzalez, J. Nonlinear
  /// Sci. 6 (1996) 449; Betsch & Steinmann, IJNME 53 (2002) 1775.
  ///   s = h²/2,  p = h v₀,  a = ½ h ω₀,  b = ½ h L₀
  kMidpoint,
  /// Backward differences of order 2, which dissipate the energy of unresolved motion: Hairer &
  /// Wanner II, section V.1. Minus marks the previous step.
  ///   s = 4h²/9,  p = Δx₋/3 + (8 v₀ − 2 v₋) h/9,  a = w₋/3,  b = (8 L₀ − 2 L₋) h/9
  kBdf2,
};

/// One step of an island as a system of equations for Newton's method. Unknowns: Δx of each body, w
/// of each rotating body with R₁ = cay(w) R₀, and λ of each row.
///   r_x = m (Δx − p) − s f
///   r_w = (1 + ½ŵ) J₀ (w − a) − (1 − ½ŵ)(b + s T),  J₀ = R₀ I R₀ᵀ
///   g = 0 at the end of the step
/// Forces f and torques T are taken at the means d̄, r̄ of both ends (midpoint) or at the end
/// (BDF2). An arm r changes by w × r̄ exactly. Scaling: bodies by √m, rows to unit norm.
class ImplicitStep {
 public:
  // Defined in the .cpp file: copies of so many fields are compiled once.
  ImplicitStep(const ImplicitStep& other);
  ImplicitStep(ImplicitStep&& other) noexcept;
  ImplicitStep& operator=(const ImplicitStep& other);
  ImplicitStep& operator=(ImplicitStep&& other) noexcept;
  ~ImplicitStep();

  explicit ImplicitStep(const EquationsOfMotion& equations);

  std::size_t size() const { return left_.size(); }
  bool has_dampers() const { return has_dampers_; }

  // ---- state at the start of the step
  void gather_state(const List<BodyState>& states, const EquationsOfMotion& equations);
  void scatter_state(const EquationsOfMotion& equations, List<BodyState>* states) const;

  /// Writes the points of all bodies at the current state.
  void write_points(Points* points) const;

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
  const List<double>& residual() const { return residual_; }
  /// Replaces b by the inverse of the derivative times b. Returns false where the derivative is
  /// singular. Called once after each evaluate().
  bool solve(double* b) { return lu_.solve(b); }
  /// Adds a scaled change from solve() to the unknowns. Returns the largest displacement of a point
  /// [m].
  double add(const double* change, Unknowns* unknowns) const;
  /// Largest error of a row at the last evaluate() [m].
  double worst_row() const { return worst_row_; }
  /// Largest error of a momentary row at the last evaluate() [m]. Momentary rows depend on other
  /// rows at the start of the step and have no force in it.
  double worst_momentary_row() const { return worst_momentary_row_; }
  /// Removes or restores the force of momentary rows. With a force energy is kept: the mean
  /// Jacobian over the step has a direction where the Jacobian at its start has none.
  void leave_out_momentary_rows(bool are_out, const EquationsOfMotion& equations);
  /// Whether redundant rows are met at the current pose. Makes unmet rows ordinary rows again.
  bool redundant_rows_are_met(double t, EquationsOfMotion* equations) const {
    return equations->redundant_rows_are_met(t, x_, q_);
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
    for (auto* list : {&self.dx_before_, &self.v_before_, &self.w_before_, &self.L_before_})
      visit(*list);
    for (auto& shape : self.shapes_) visit(shape.before);
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

  /// Kind of link. A rod has g = ½(d·d − ℓ²) and force λ d, a ball joint g = d and force λ. A
  /// spring has force λ d/‖d‖ (midpoint: d̄ over the mean of ‖d‖); g is its law divided by its
  /// stiffness, so that no spring is too stiff.
 private:
  enum class Kind { kRod, kBall, kGeneral, kSpring };
  /// Movable end of a link.
  struct End {
    std::size_t point = 0;
    int unknown = -1;  // first unknown of the body; -1: a fixed point
    int dofs = 0;      // 0, 3 or 6
    Eigen::Vector3d anchor;
    double sign = 0.0;
  };
  struct Link {
    Kind kind = Kind::kRod;
    std::array<End, 2> ends;
    double stiffness = 0.0, damping = 0.0;
    int unknown = 0;  // index of its first row among the unknowns
    int rows = 1;
    std::size_t slot = 0;  // first entry in slots_
    bool is_between_points = false;
    JointKind joint{};
    std::array<Eigen::Matrix3d, 2> frames;               // body axes; general joints only
    double radius = 0.0;                                 // general joints only [m]
    std::array<std::uint8_t, kMaxJointRows> function{};  // index per row; soft rows last
    int rigid_rows = 1;
    std::size_t first_soft = 0;  // index in EquationsOfMotion::soft_coordinates()
    const CustomCode* custom = nullptr;
    bool has_custom_force = false;
  };
  /// Row that couples coordinates of general links.
  struct CoupledRow {
    struct Term {
      std::size_t link = 0;
      ScalarForm form;
      double ratio = 0.0;
      double start = 0.0, end = 0.0;  // q at both ends of the step
    };
    std::array<Term, 2> terms;
    std::size_t row = 0;  // row number in EquationsOfMotion
    int unknown = 0;
    double metres = 1.0;
    std::size_t first_slot = 0;
    // Values of the current step.
    bool is_left_out = false, is_redundant = false;
    double scale = 1.0, target = 0.0;
  };
  /// Law of a soft row in one step: given λ + taken q₁ = target.
  struct SoftRow {
    double given = 0.0, taken = 1.0, target = 0.0;
    double start = 0.0, end = 0.0;  // q at both ends of the step
  };
  /// Data of a link in the current step.
  struct Shape {
    Eigen::Vector3d d0;
    std::array<Eigen::Vector3d, 2> r0;  // arms of ends A and B
    double target = 0.0;                // ½ℓ² of a rod; known part of the law of a spring [m]
    double compliance = 0.0;            // ε of a spring [m/N]
    RowVector offset;                   // target of a ball joint or a general joint
    double scale = 1.0;                 // scale of the joint's equations
    RowVector row_scale;                // scale per row of a general joint
    // Axes of a general joint at the start and at the end of the step.
    std::array<Eigen::Matrix3d, 2> axes0{Eigen::Matrix3d::Identity(), Eigen::Matrix3d::Identity()};
    std::array<Eigen::Matrix3d, 2> axes1 = axes0;
    // Arm and axes of a general joint on B, with its frame at the end of the step and body B at the
    // start.
    Eigen::Vector3d next_r_B = Eigen::Vector3d::Zero();
    Eigen::Matrix3d next_axes_B = Eigen::Matrix3d::Identity();
    std::array<double, 2> swing{};  // Σ‖torque‖ at each end of a general joint [N m]
    double before = 0.0;            // ‖d‖ of a spring one step ago [m]
    std::array<bool, kMaxJointRows> is_left_out{}, is_redundant{};  // rows without a force
    const CustomCode* custom = nullptr;
    // Velocity and spin of ends of a custom force that are fixed points.
    std::array<Eigen::Vector3d, 2> fixed_velocity, fixed_spin;
    // Results of the last evaluate().
    Eigen::Vector3d d, force;
  };
  /// Data of a rotating body in the current step.
  struct Turning {
    Eigen::Matrix3d R0, J0;
    Eigen::Vector3d a, b;
    Eigen::Vector3d torque;  // total torque
    Eigen::Matrix3d B;       // B r₀ is the mean arm
    Eigen::Matrix3d C;       // 1 − ½ ŵ
  };

  // ---- joints with the rows of their kind (implicit_joints.cpp)

  /// Derivatives of the vectors of a joint with respect to the displacement of one end.
  struct VectorSlopes {
    using Slope = Eigen::Matrix<double, 3, 6>;
    Slope arm = Slope::Zero(), d = Slope::Zero();
    std::array<Slope, 3> axes{Slope::Zero(), Slope::Zero(), Slope::Zero()};

    Slope of(VectorRef u, std::size_t end) const;
  };
  /// Derivatives of a row's J: of the force on B, and of the torques on A and B.
  struct JacobianSlopes {
    using Slope = VectorSlopes::Slope;
    Slope force = Slope::Zero(), torque_A = Slope::Zero(), torque_B = Slope::Zero();

    /// Adds the derivatives of Uᵀf, where f is the other vector of the row.
    void add(VectorRef u, VectorRef other, const JointVectors& v, const VectorSlopes& slopes,
             std::size_t end);
    void add(double lambda, const JacobianSlopes& of_row) {
      force += lambda * of_row.force;
      torque_A += lambda * of_row.torque_A;
      torque_B += lambda * of_row.torque_B;
    }
    /// Adds the derivative of a scalar factor of J, given the gradient of the factor.
    void add(const Jacobian& J, const Eigen::Matrix<double, 1, 6>& gradient) {
      force += J.j3 * gradient;
      torque_A += J.j2 * gradient;
      torque_B += J.j4 * gradient;
    }
  };
  /// Vectors of a joint at the end of the step and where forces are taken, and the slopes of its
  /// vectors at the end.
  struct GeneralMotion {
    JointVectors at_end, at_force;
    std::array<VectorSlopes, 2> slopes;
  };
  /// Row in a step: J where forces are taken, with the slopes of λJ; value at the end of the step
  /// (of an angle its change over the step), and gradient of the value.
  struct FormInStep {
    Jacobian J;
    double value = 0.0;
    std::array<JacobianSlopes, 2> slopes;
    std::array<Eigen::Matrix<double, 1, 6>, 2> gradient{Eigen::Matrix<double, 1, 6>::Zero(),
                                                        Eigen::Matrix<double, 1, 6>::Zero()};
  };
  /// Rows and forces of a general joint, with derivatives by the displacements of both ends.
  struct GeneralForces {
    Eigen::Vector3d force = Eigen::Vector3d::Zero();
    std::array<Eigen::Vector3d, 2> torque{Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()};
    std::array<JacobianSlopes, 2> slopes;
    std::array<Jacobian, kMaxJointRows> J;
    std::array<std::array<Eigen::Matrix<double, 1, 6>, 2>, kMaxJointRows> gradient;
    RowVector value;
  };

  // ---- implicit_compile.cpp
  struct Forest;
  /// Links and coupled rows, listed by the body they are assigned to.
  struct RowsOfBodies {
    List<List<std::size_t>> links, coupled;
    bool have_loops;
  };
  Forest find_forest() const;
  RowsOfBodies share_rows(const Forest& forest);
  void make_nodes(const EquationsOfMotion& equations);
  List<SaddleLu::Link> rows_between(const Forest& forest, const RowsOfBodies& rows) const;
  void set_rule(double h, ImplicitRule rule);
  void predict();
  void find_slots();
  void place_link(std::size_t l, const EquationsOfMotion& equations);
  void ask_link(std::size_t l, const EquationsOfMotion& equations);
  void ask_spring(const Link& link, const Prescribed& length, Shape* shape) const;
  void scale_equations(const EquationsOfMotion& equations);
  bool leave_out_dependent(double t, EquationsOfMotion* equations);

  // ---- implicit_equations.cpp
  void evaluate_bodies(const Unknowns& unknowns);
  struct LinkMotion;
  struct LinkPull;
  LinkMotion move_link(const Link& link, Shape* shape, const Unknowns& unknowns) const;
  LinkPull pull_link(const Link& link, const Eigen::Vector3d& d1, Shape* shape,
                     const Unknowns& unknowns);
  void evaluate_link(const Link& link, Shape* shape, const Unknowns& unknowns);
  void evaluate_rod(const Link& link, Shape* shape, const Unknowns& unknowns);
  void place_axes(const EquationsOfMotion& equations, const Link& link,
                  std::array<Eigen::Matrix3d, 2>* axes) const;
  static JointVectors start_of(const Shape& shape);
  void begin_general(const Link& link, Shape* shape) const;
  void move_general(const Link& link, const Shape& shape, const Unknowns& unknowns,
                    GeneralMotion* motion) const;
  void begin_softs(const Link& link, const Shape& shape, const EquationsOfMotion& equations);
  void evaluate_general(const Link& link, Shape* shape, const Unknowns& unknowns);
  void evaluate_form(const ScalarForm& form, const Link& link, const JointVectors& start,
                     const GeneralMotion& motion, double lambda, FormInStep* at) const;
  void evaluate_custom_row(const Link& link, const JointVectors& start, const GeneralMotion& motion,
                           double lambda, FormInStep* at) const;
  static JointVectors displaced(const GeneralMotion& motion, std::size_t end, int number,
                                double step);
  void add_custom_force(const Link& link, const Shape& shape, const GeneralMotion& motion,
                        const JointVectors& start, const Unknowns& unknowns,
                        GeneralForces* forces) const;
  void ask_custom_force(const Link& link, const EquationsOfMotion& equations, Shape* shape) const;
  void write_slopes(const Link& link, std::size_t e, const Eigen::Matrix3d& C,
                    const std::array<JacobianSlopes, 2>& slopes, std::size_t* slot);
  void write_general(const Link& link, const Shape& shape, const GeneralForces& forces);

  // ---- couplings (implicit_joints.cpp)
  void add_coupled(const EquationsOfMotion& equations);
  void find_coupled_slots();
  void begin_coupled(const EquationsOfMotion& equations);
  void evaluate_coupled(CoupledRow* coupled, const Unknowns& unknowns);
  void write_coupled(const CoupledRow::Term& term, const FormInStep& there, double scale,
                     std::size_t* slot);
  void note_row(const Shape& shape, std::size_t k, double error) {
    double& worst = shape.is_left_out[k] ? worst_momentary_row_ : worst_row_;
    if (!shape.is_redundant[k]) worst = larger(worst, error);
  }

  std::size_t bodies_ = 0, rotating_ = 0;
  List<Link> links_;
  List<int> first_unknown_;  // per body
  List<double> mass_;
  List<Eigen::Vector3d> inertia_;
  List<double> radius_;  // radius of gyration, per rotating body [m]
  // Whether rows may depend on each other: loops, or several links on a body.
  bool may_depend_ = false;
  bool has_dampers_ = false;
  SaddleLu lu_;
  // Entries of links; entries of unknowns and blocks of bodies.
  List<SaddleLu::Slot> slots_, diagonal_;

  List<Eigen::Vector3d> x_, v_;  // per point, fixed points last
  List<Eigen::Quaterniond> q_;
  List<Eigen::Vector3d> angular_velocity_;

  // ---- previous step of BDF2, per body
  List<Eigen::Vector3d> dx_before_, v_before_, w_before_, L_before_;

  ImplicitRule rule_ = ImplicitRule::kMidpoint;
  double t_ = 0.0, h_ = 0.0, s_ = 0.0;
  double share_ = 0.5;  // share of the step at which forces are taken
  List<Eigen::Vector3d> p_;
  List<Eigen::Vector3d> force_, torque_;  // constant loads [N], [N m]
  List<Eigen::Vector3d> shift_;           // Δx per point; of fixed points that move
  List<Turning> J_angular_;
  List<Shape> shapes_;
  List<SoftRow> softs_;
  List<CoupledRow> coupled_;
  List<double> left_, right_;  // scales of equations and unknowns
  List<double> residual_;
  double worst_row_ = 0.0, worst_momentary_row_ = 0.0, frequency_ = 0.0;
  double scale_ = 1.0, extent_ = 1.0;
  List<char> is_dependent_;
  List<double> squares_;  // ω² per body
};

}  // namespace constraint_sim::engine
