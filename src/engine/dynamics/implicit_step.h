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

/// How a step is made.
enum class ImplicitRule {
  /// Keeps rods, energy and momentum to rounding at any step, also where the motion is too fast to
  /// be
  /// resolved: Simo & Wong, IJNME 31 (1991) 19; Gonzalez, J. Nonlinear Sci. 6 (1996) 449; Betsch &
  /// Steinmann, IJNME 53 (2002) 1775.
  kMidpoint,
  /// Takes the energy out of such motions: backward differences of order 2. Hairer & Wanner II,
  /// section V.1.
  kBdf2,
};

/// One step of an island as a system of equations for Newton's method. Unknowns: Δx and, of a body
/// that turns, w with R₁ = cay(w) R₀, so that an arm r changes by w × r̄ exactly (bars: means of
/// both ends of the step); of each row its λ.
///   r_x = m (Δx − p) − s f
///   r_w = (1 + ½ŵ) J₀ (w − a) − (1 − ½ŵ)(b + s T)       J₀ = R₀ I R₀ᵀ
///   g = 0 at the end of the step
/// with forces f and torques T at the mean d̄, r̄ (midpoint) or at the end, and
///   midpoint: s = h²/2,  p = h v₀,                          a = ½ h ω₀,  b = ½ h L₀
///   BDF2:     s = 4h²/9, p = Δx₋/3 + (8 v₀ − 2 v₋) h/9,     a = w₋/3,    b = (8 L₀ − 2 L₋) h/9
/// where minus is of the step before. A rod has g = ½(d·d − ℓ²) and pulls with λ d; a ball joint
/// has g = d and pulls with λ; a spring pulls with λ d/‖d‖ (midpoint: d̄ over the mean of ‖d‖), and
/// has for g its law divided by its stiffness, so that none is too stiff. Equations and unknowns
/// are scaled: bodies by √m, rows to unit norm.
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

  // ---- the state that is carried
  void gather_state(const List<BodyState>& states, const EquationsOfMotion& equations);
  void scatter_state(const EquationsOfMotion& equations, List<BodyState>* states) const;

  /// Points of all bodies in that state.
  void write_points(Points* points) const;

  // ---- one step

  /// Δx and w, body by body, then λ; what is not there is zero.
  using Unknowns = List<double>;

  /// From time t to t + h [s], h of either sign; `equations` know what acts. BDF2 goes on from a
  /// finish() of the same h, whatever its rule, with the state as it was left.
  /// False where the step before has to be shorter.
  bool begin(double t, double h, ImplicitRule rule, EquationsOfMotion* equations);
  /// The residual and its derivative there.
  void evaluate(const Unknowns& unknowns);
  const List<double>& residual() const { return residual_; }
  /// Replaces b by the inverse of the derivative times b; false where it is singular. Once after
  /// each evaluate().
  bool solve(double* b) { return lu_.solve(b); }
  /// Adds a scaled change, as solve() gives it, and tells how far it moves a point at most [m].
  double add(const double* change, Unknowns* unknowns) const;
  /// How far the rows are off, at the last evaluate() [m].
  double worst_row() const { return worst_row_; }
  /// The same of rows that depend on others where the step begins, and have no force in it.
  double worst_momentary_row() const { return worst_momentary_row_; }
  /// Lets these rows have a force after all, or takes it from them again. Their mean Jacobian over
  /// the step has a direction where the one at its start has none, and the energy is kept.
  void leave_out_momentary_rows(bool are_out, const EquationsOfMotion& equations);
  /// Whether redundant rows are met where the bodies are; if not, they are rows again.
  bool redundant_rows_are_met(double t, EquationsOfMotion* equations) const {
    return equations->redundant_rows_are_met(t, x_, q_);
  }
  /// Takes the end of the step for the state; its impulses go to `equations`.
  void finish(const Unknowns& unknowns, EquationsOfMotion* equations);

  /// Largest ω of the bodies by what held them in the last step [rad/s].
  double frequency() const { return frequency_; }
  /// The same of one body, in the order of EquationsOfMotion.
  double frequency_of(std::size_t body) const { return std::sqrt(squares_[body]); }
  /// Nothing is known of what holds the bodies.
  void forget();
  /// Visits all that outlives a span, beside the bodies, as engine/memory.h says; with what BDF2
  /// needs of the step before.
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
  /// What is largest of those that turn and are swung with an ω of no more than this [rad/s]: spin
  /// [rad/s], and spin times radius of gyration [m/s].
  std::pair<double, double> largest_spin(double most_frequency) const;
  /// The largest coordinate or length [m].
  double scale() const { return scale_; }
  /// The same but for where the scene lies: from one body to the others, or a length [m].
  double extent() const { return extent_; }

 private:
  enum class Kind { kRod, kBall, kGeneral, kSpring };
  /// An end of a link that moves: its body and that one's first unknown.
  struct End {
    std::size_t point = 0;
    int unknown = -1;  // -1: a fixed point
    int dofs = 0;      // 0, 3 or 6
    Eigen::Vector3d anchor;
    double sign = 0.0;
  };
  struct Link {
    Kind kind = Kind::kRod;
    std::array<End, 2> ends;
    double stiffness = 0.0, damping = 0.0;
    int unknown = 0;  // of its first row
    int rows = 1;
    std::size_t slot = 0;  // first of its slots
    bool is_between_points = false;
    JointKind joint{};
    std::array<Eigen::Matrix3d, 2> frames;               // of a general one, in its bodies
    double radius = 0.0;                                 // of a general one [m]
    std::array<std::uint8_t, kMaxJointRows> function{};  // of its rows, soft ones last
    int rigid_rows = 1;
    std::size_t first_soft = 0;  // as EquationsOfMotion::soft_coordinates()
    const CustomCode* custom = nullptr;
    bool has_custom_force = false;
  };
  /// A row that couples coordinates of general links.
  struct CoupledRow {
    struct Term {
      std::size_t link = 0;
      ScalarForm form;
      double ratio = 0.0;
      double start = 0.0, end = 0.0;  // q at both ends of the step
    };
    std::array<Term, 2> terms;
    std::size_t row = 0;  // as EquationsOfMotion has it
    int unknown = 0;
    double metres = 1.0;
    std::size_t first_slot = 0;
    // in a step
    bool is_left_out = false, is_redundant = false;
    double scale = 1.0, target = 0.0;
  };
  /// The law of a soft row in a step: given λ + taken q₁ = target.
  struct SoftRow {
    double given = 0.0, taken = 1.0, target = 0.0;
    double start = 0.0, end = 0.0;  // q at both ends of the step
  };
  /// What it is in a step.
  struct Shape {
    Eigen::Vector3d d0;
    std::array<Eigen::Vector3d, 2> r0;  // arms of both ends
    double target = 0.0;      // ½ℓ² of a rod; of a spring what its law has of before [m]
    double compliance = 0.0;  // ε, of a spring [m/N]
    RowVector offset;         // of a ball joint or a general one
    double scale = 1.0;       // of its equations
    RowVector row_scale;      // the same, of a general one by row
    // of a general one: at the ends of the step
    std::array<Eigen::Matrix3d, 2> axes0{Eigen::Matrix3d::Identity(), Eigen::Matrix3d::Identity()};
    std::array<Eigen::Matrix3d, 2> axes1 = axes0;
    // of a general one, by the frame on B at the end of the step, with B where it was at the start
    Eigen::Vector3d next_r_B = Eigen::Vector3d::Zero();
    Eigen::Matrix3d next_axes_B = Eigen::Matrix3d::Identity();
    std::array<double, 2> swing{};  // of a general one: Σ‖torque‖ at each end [N m]
    double before = 0.0;            // ‖d‖ of a spring a step ago [m]
    std::array<bool, kMaxJointRows> is_left_out{}, is_redundant{};  // rows that have no force
    const CustomCode* custom = nullptr;
    // of a custom force: how ends that are fixed points move
    std::array<Eigen::Vector3d, 2> fixed_velocity, fixed_spin;
    // at the last evaluate()
    Eigen::Vector3d d, force;
  };
  /// What a body that turns is in a step.
  struct Turning {
    Eigen::Matrix3d R0, J0;
    Eigen::Vector3d a, b;
    Eigen::Vector3d torque;  // all of it
    Eigen::Matrix3d B;       // B r₀ is the mean arm
    Eigen::Matrix3d C;       // 1 − ½ ŵ
  };

  // ---- of a joint with the rows of its kind (implicit_joints.cpp)

  /// Derivatives of its vectors by the displacement of one of its ends.
  struct VectorSlopes {
    using Slope = Eigen::Matrix<double, 3, 6>;
    Slope arm = Slope::Zero(), d = Slope::Zero();
    std::array<Slope, 3> axes{Slope::Zero(), Slope::Zero(), Slope::Zero()};

    Slope of(VectorRef u, std::size_t end) const;
  };
  /// Those of J: of the force on B, and of the torques on A and B.
  struct JacobianSlopes {
    using Slope = VectorSlopes::Slope;
    Slope force = Slope::Zero(), torque_A = Slope::Zero(), torque_B = Slope::Zero();

    /// Adds those of Uᵀf, f the other vector of the row.
    void add(VectorRef u, VectorRef other, const JointVectors& v, const VectorSlopes& slopes,
             std::size_t end);
    void add(double lambda, const JacobianSlopes& of_row) {
      force += lambda * of_row.force;
      torque_A += lambda * of_row.torque_A;
      torque_B += lambda * of_row.torque_B;
    }
    /// Of a factor of J with this gradient.
    void add(const Jacobian& J, const Eigen::Matrix<double, 1, 6>& gradient) {
      force += J.j3 * gradient;
      torque_A += J.j2 * gradient;
      torque_B += J.j4 * gradient;
    }
  };
  /// Its vectors at the end of the step and where forces are taken; slopes of those at the end.
  struct GeneralMotion {
    JointVectors at_end, at_force;
    std::array<VectorSlopes, 2> slopes;
  };
  /// A row in a step: J where forces are taken, with the slopes of λJ; at the end of the step the
  /// value, of an angle its change over the step, and its gradient.
  struct FormInStep {
    Jacobian J;
    double value = 0.0;
    std::array<JacobianSlopes, 2> slopes;
    std::array<Eigen::Matrix<double, 1, 6>, 2> gradient{Eigen::Matrix<double, 1, 6>::Zero(),
                                                        Eigen::Matrix<double, 1, 6>::Zero()};
  };
  /// Its rows, what they do, and the derivatives of both by the displacements of both ends.
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
  /// Links and coupled rows by the body whose they are.
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

  // ---- of couplings (implicit_joints.cpp)
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
  List<int> first_unknown_;  // of bodies
  List<double> mass_;
  List<Eigen::Vector3d> inertia_;
  List<double> radius_;      // of gyration
  bool may_depend_ = false;  // more rows than a forest of bodies has
  bool has_dampers_ = false;
  SaddleLu lu_;
  List<SaddleLu::Slot> slots_, diagonal_;  // of links; of unknowns and blocks of bodies

  List<Eigen::Vector3d> x_, v_;  // of points; those that are fixed last
  List<Eigen::Quaterniond> q_;
  List<Eigen::Vector3d> angular_velocity_;

  // ---- what BDF2 needs of the step before, of bodies
  List<Eigen::Vector3d> dx_before_, v_before_, w_before_, L_before_;

  ImplicitRule rule_ = ImplicitRule::kMidpoint;
  double t_ = 0.0, h_ = 0.0, s_ = 0.0;
  double share_ = 0.5;  // of the step at which forces are taken
  List<Eigen::Vector3d> p_;
  List<Eigen::Vector3d> force_, torque_;  // constant ones [N], [N m]
  List<Eigen::Vector3d> shift_;           // Δx of points that are fixed but move
  List<Turning> J_angular_;
  List<Shape> shapes_;
  List<SoftRow> softs_;
  List<CoupledRow> coupled_;
  List<double> left_, right_;  // scales of equations and unknowns
  List<double> residual_;
  double worst_row_ = 0.0, worst_momentary_row_ = 0.0, frequency_ = 0.0;
  double scale_ = 1.0, extent_ = 1.0;
  List<char> is_dependent_;
  List<double> squares_;  // ω² of bodies
};

}  // namespace constraint_sim::engine
