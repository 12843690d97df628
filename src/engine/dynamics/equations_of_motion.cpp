#include "engine/dynamics/equations_of_motion.h"

#include <cmath>

#include "engine/dynamics/force_elements.h"
#include "engine/math/larger.h"
#include "engine/math/quaternion_state.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;
using ConstVector = Eigen::Map<const Vector3d>;
using Vector = Eigen::Map<Vector3d>;

// Rows are left out whose pivot falls below this share of its diagonal entry, for forces and for
// both projections. The values lose the least energy near a singular pose that is passed at speed
// v with error ε and transverse acceleration a: y³ = ε v²/a, p ~ y².
constexpr double kLeastPivotOfForces = 3e-11;
constexpr double kLeastPivotOfProjections = 1e-9;
// Velocities near a pose with left-out rows are off by up to the square root of the rows' pivot.
constexpr double kLeftOutRatesAgree = 1e-4;  // share of the largest speed
// Share of the speed by which rates of rods may be off from those of their motors.
constexpr double kRodRatesMet = 1e-12;
constexpr int kMostProjectionSteps = 8;
// Share of the scene's size; a larger error is no solution.
constexpr double kProjectionFailed = 1e-10;

}  // namespace

EquationsOfMotion::EquationsOfMotion(const EquationsOfMotion& other) = default;
EquationsOfMotion::EquationsOfMotion(EquationsOfMotion&& other) noexcept = default;
EquationsOfMotion& EquationsOfMotion::operator=(const EquationsOfMotion& other) = default;
EquationsOfMotion& EquationsOfMotion::operator=(EquationsOfMotion&& other) noexcept = default;
EquationsOfMotion::~EquationsOfMotion() = default;

EquationsOfMotion::EquationsOfMotion(List<int> joints, const List<Joint>& all_joints,
                                     const Ends& ends, const List<MassProperties>& masses,
                                     const List<CoupledTerms>& couplings, const List<int>& idle,
                                     const List<char>& open)
    : IslandModel(std::move(joints), all_joints, ends, masses, couplings, idle, open),
      inputs_(*this, masses),
      kinematics_(*this),
      coordinates_(*this),
      redundant_(*this),
      forces_(*this) {
  delassus_.compile(*this, redundant_.is_redundant());
  forces_.sort(delassus_.unknown());
  acceleration_.assign(points(), Vector3d::Zero());
  for (auto* list : {&torque_, &angular_acceleration_}) list->assign(rotating_, Vector3d::Zero());
  solution_.assign(rows_.size(), 0.0);
  if (is_chain_) {
    tridiagonal_.resize(rows_.size());
    falls_.resize(rows_.size());
  }
  if (is_chain_of_bodies_) pairs_ = pairs_of_chain(*this);
  tree_ = tree_of(*this);
}

// ---- an interval without jumps

void EquationsOfMotion::begin_step(const List<JointData>& states) {
  if (!coordinates_.empty()) coordinates_.begin_step(*this, states);
  forces_.begin_step();
  delassus_.begin_step();
  redundant_.begin_step();
}

void EquationsOfMotion::begin(double t, const List<BodyState>& states, const Vector3d& gravity,
                              const List<AppliedWrench>& loads,
                              const List<PrescribedMotion>& motions, double since_tick) {
  if (inputs_.begin(*this, t, states, gravity, loads, motions, since_tick))
    redundant_.ask_for_choice();
  kinematics_.place_fixed_points(*this, t, &inputs_);
  coordinates_.set_time(t);
  energy_.forget();
  fixed_scale_ = inputs_.scale();
  for (std::size_t p = bodies_.size(); p < points(); ++p)
    fixed_scale_ = std::max(fixed_scale_, kinematics_.position()[p].cwiseAbs().maxCoeff());
}

void EquationsOfMotion::add_custom_loads(double t, const List<BodyState>& states) {
  if (!has_custom_forces_) return;
  List<double> y(size());
  gather_state(*this, states, y.data());
  kinematics_.place(*this, t, y.data(), &inputs_);
  kinematics_.move(*this, inputs_, y.data());
  for_each_custom_force(*this, kinematics_, t,
                        [&](std::size_t point, const Vector3d& force, const Vector3d& torque) {
                          if (point < bodies_.size()) inputs_.add_load(*this, point, force, torque);
                        });
}

// Largest coordinate of bodies in y, and of coupled coordinates as last noted [m].
double EquationsOfMotion::largest_coordinate(const double* y) const {
  const auto n = static_cast<Eigen::Index>(3 * bodies_.size());
  return std::max(Eigen::VectorXd::Map(y, n).cwiseAbs().maxCoeff(),
                  coordinates_.largest_coupled(*this));
}

bool EquationsOfMotion::start(double t, double* y, double* dydt) {
  scale_ = std::max(fixed_scale_, largest_coordinate(y));
  redundant_.set_inconsistent(false);
  time_ = t;
  substep_ = 0.0;  // nothing has moved since the previous substep
  redundant_.set_came_back(redundant_.is_passing());
  if (redundant_.came_back() && !energy_.is_known()) note_energy(t, y);
  if (redundant_.has_chosen()) return project_start(t, y) && restart(y, dydt);
  // Some mechanisms are redundant only where the joints are met.
  const int not_yet = choose_rows(t, y);
  if (!project_start(t, y)) return false;
  if (not_yet > 0) {
    choose_rows(t, y);
    if (!project_start(t, y)) return false;
  }
  return redundant_.limit(placed_rows(), delassus_) && restart(y, dydt);
}

void EquationsOfMotion::scatter_state(const double* y, List<BodyState>* states) {
  scale_ = std::max(fixed_scale_, largest_coordinate(y));
  engine::scatter_state(*this, y, states);
}

void EquationsOfMotion::keep_impulses() {
  forces_.keep();
  if (!coordinates_.empty()) coordinates_.keep();
}

void EquationsOfMotion::restore_impulses() {
  forces_.restore();
  if (!coordinates_.empty()) coordinates_.restore();
}

void EquationsOfMotion::keep_first_stage() {
  forces_.keep_first_stage();
  coordinates_.keep();
}

void EquationsOfMotion::restore_first_stage() {
  forces_.restore_first_stage();
  coordinates_.restore();
}

void EquationsOfMotion::forget_redundant_rows() {
  redundant_.forget(*this, &delassus_, &forces_);
  inputs_.forget();
  scale_ = 0.0;
}

// ---- for methods with their own time stepping

void EquationsOfMotion::move_with_time(double t) {
  inputs_.update(*this, t);
  if (inputs_.fixed_points_move()) kinematics_.place_fixed_points(*this, t, &inputs_);
}

void EquationsOfMotion::read_pose(const List<Vector3d>& positions,
                                  const List<Quaterniond>& orientations) {
  pose_.resize(size());
  for (std::size_t i = 0; i < bodies_.size(); ++i) Vector(pose_.data() + 3 * i) = positions[i];
  for (std::size_t i = 0; i < rotating_; ++i)
    Eigen::Map<Eigen::Vector4d>(pose_.data() + layout().q_at + 4 * i) = orientations[i].coeffs();
}

bool EquationsOfMotion::find_dependent(double t, const List<Vector3d>& positions,
                                       const List<Quaterniond>& orientations, double least,
                                       List<char>* rows) {
  read_pose(positions, orientations);
  place(t, pose_.data());
  factor(least);
  delassus_.forget_factors();
  if (redundant_.is_choice_due(placed_rows(), delassus_)) {
    find_values();
    if (redundant_.are_off(placed_rows(), delassus_))
      return false;  // a choice needs rows that are met
    choose_again(t, pose_.data());
    factor(least);
    delassus_.forget_factors();
  }
  rows->assign(rows_.size(), 0);
  for (std::size_t i = 0; i < rows_.size(); ++i)
    (*rows)[i] =
        redundant_.is_redundant()[i] ? kRedundant : (delassus_.is_left_out(i) ? kMomentary : '\0');
  delassus_.count_dependent();
  return true;
}

bool EquationsOfMotion::redundant_rows_are_met(double t, const List<Vector3d>& positions,
                                               const List<Quaterniond>& orientations) {
  if (delassus_.redundant() == 0) return true;
  read_pose(positions, orientations);
  place(t, pose_.data());
  find_values();
  return !restore_redundant_if_off();
}

void EquationsOfMotion::add_response(const Motions& change, const List<double>& impulses,
                                     double share, double* y) {
  energy_.forget();
  for (std::size_t i = 0; i < bodies_.size(); ++i)
    Vector(y + layout().v_at + 3 * i) += share * change.linear[i];
  for (std::size_t i = 0; i < rotating_; ++i)
    Vector(y + layout().L_at + 3 * i) +=
        share * kinematics_.inverse_inertia()[i].inverse() * change.angular[i];
  for (std::size_t i = 0; i < rows_.size(); ++i) forces_.impulses()[i] += share * impulses[i];
}

// ---- results

double EquationsOfMotion::largest_force() const {
  double largest = forces_.largest();
  for (std::size_t i = 0; i < bodies_.size(); ++i)
    largest = std::max(largest, inputs_.acceleration()[i].norm() / inverse_mass_[i]);
  return largest;
}

double EquationsOfMotion::frequency() {
  if (is_tree()) kinematics_.place_general_rows(*this);
  return forces_.frequency(*this, inputs_, kinematics_, scale_);
}

// ---- one evaluation

void EquationsOfMotion::place(double t, const double* y) {
  inputs_.update(*this, t);
  kinematics_.place(*this, t, y, &inputs_);
}

void EquationsOfMotion::factor(double least) {
  if (rows_.empty()) return;
  delassus_.evaluate(kinematics_);
  delassus_.factor(least);
  if (delassus_.left_out() > 0 && redundant_.has_chosen())
    redundant_.verify_left_out(placed_rows(), least, &delassus_);
}

// Computes the right-hand side C̈_target − γ − G a_free.
void EquationsOfMotion::find_right_hand_side(const Vector3d* free, double* b) const {
  const List<std::size_t>& unknown = delassus_.unknown();
  const List<Vector3d>& J = kinematics_.J_linear();
  for (std::size_t l = 0; l < first_.armed; ++l) {
    const Row& row = rows_[l];
    const Vector3d d_dot = kinematics_.velocity()[row.b] - kinematics_.velocity()[row.a];
    b[unknown[l]] = -d_dot.squaredNorm() - J[l].dot(free[row.b] - free[row.a]);
  }
  for (std::size_t l = first_.armed; l < first_.ball; ++l) {
    const Row& row = rows_[l];
    const Vector3d a = free[row.b] - free[row.a] + kinematics_.separation_bias(*this, l);
    b[unknown[l]] = -kinematics_.separation_rate(*this, l).squaredNorm() - J[l].dot(a);
  }
  for (std::size_t l = first_.ball; l < first_.general; ++l) {
    const Link& link = links_[l];
    Vector3d a = free[link.b] - free[link.a];
    if (link.has_arms) a += kinematics_.separation_bias(*this, l);
    for (std::size_t k = 0; k < 3; ++k)
      b[unknown[row_of(l) + k]] = -a[static_cast<Eigen::Index>(k)];
  }
  for (const GeneralRow& row : general_rows_) {
    const Row& of = rows_[row.row];
    b[unknown[row.row]] =
        -gamma(row.form, kinematics_.vectors(row.link), kinematics_.motion(row.link)) -
        J[row.row].dot(free[of.b] - free[of.a]);
  }
  for (const CoupledRow& coupled : coupled_) {
    double& sum = b[unknown[coupled.row]] = 0.0;
    for (const CoupledRow::Term& term : coupled.terms) {
      const Row& of = part(term.part);
      sum -= term.ratio *
                 gamma(term.form, kinematics_.vectors(term.link), kinematics_.motion(term.link)) +
             J[term.part].dot(free[of.b] - free[of.a]);
    }
  }
  if (rotating_ > 0) delassus_.subtract_angular(*this, kinematics_, angular_acceleration_, b);
  if (inputs_.motions().empty()) return;
  for (std::size_t i = 0; i < rows_.size(); ++i) b[unknown[i]] += inputs_.acceleration_target()[i];
}

void EquationsOfMotion::accelerate(std::size_t stage, const double* y, double* dydt) {
  const auto& [v_at, q_at, L_at, size] = layout();
  double* const lambda = forces_.stage(stage);
  std::copy(inputs_.torque().begin(), inputs_.torque().end(), torque_.begin());
  const Vector3d* free = inputs_.acceleration().data();  // accelerations of bodies without the rows
  if (first_.spring < links_.size() || !softs_.empty() || has_custom_forces_) {
    std::copy(inputs_.acceleration().begin(), inputs_.acceleration().end(), acceleration_.begin());
    free = acceleration_.data();
    if (first_.spring < links_.size())
      add_spring_forces(*this, inputs_, kinematics_, lambda + rows_.size(), &acceleration_,
                        &torque_);
    if (!softs_.empty())
      add_soft_forces(*this, kinematics_, coordinates_, lambda + forces_.of_soft(*this, 0),
                      &acceleration_, &torque_);
    const auto add = [&](std::size_t point, const Vector3d& force, const Vector3d& torque) {
      acceleration_[point] += inverse_mass_[point] * force;
      if (rotates(point)) torque_[point] += torque;
    };
    if (has_custom_forces_) for_each_custom_force(*this, kinematics_, kinematics_.time(), add);
  }
  for (std::size_t i = 0; i < rotating_; ++i) {
    const Vector3d gyroscopic =
        ConstVector(y + L_at + 3 * i).cross(kinematics_.angular_velocity()[i]);
    angular_acceleration_[i] = kinematics_.inverse_inertia()[i] * (torque_[i] + gyroscopic);
  }
  find_right_hand_side(free, lambda);
  delassus_.solve(lambda);
  delassus_.apply_transpose(*this, kinematics_, lambda);
  delassus_.multipliers_to_forces(*this, inputs_, lambda);

  const std::size_t bodies = bodies_.size();
  copy_few(y + v_at, 3 * bodies, dydt);
  for (std::size_t i = 0; i < bodies; ++i)
    Vector(dydt + v_at + 3 * i) = free[i] + inverse_mass_[i] * delassus_.force()[i];
  for (std::size_t i = 0; i < rotating_; ++i) {
    write_quaternion_rate(kinematics_.angular_velocity()[i], y + q_at + 4 * i, dydt + q_at + 4 * i);
    Vector(dydt + L_at + 3 * i) = torque_[i] + delassus_.torque()[i];
  }
}

// Flattened, since the calls between classes would take a twentieth of a small island's step.
[[gnu::flatten]] void EquationsOfMotion::derivative(std::size_t stage, double t, const double* y,
                                                    double* dydt) {
  place(t, y);
  factor(kLeastPivotOfForces);
  kinematics_.move(*this, inputs_, y);
  accelerate(stage, y, dydt);
}

double EquationsOfMotion::rounding() const { return 4.0 * kEpsilon * scale_; }

// By order 3, positions err by as much as their rates times h, and turns of a body that spins by
// the change of q̇ times h ω.
double EquationsOfMotion::squared_size_of(const double* dy, double h, bool is_of_rates) const {
  double largest = 0.0;
  const auto consider = [&](double square) { largest = larger(largest, square); };
  for (std::size_t i = 0; i < bodies_.size(); ++i) {
    if (!is_of_rates) consider(ConstVector(dy + 3 * i).squaredNorm());
    consider(h * h * ConstVector(dy + layout().v_at + 3 * i).squaredNorm());
  }
  const double* dq = dy + layout().q_at;
  for (std::size_t i = 0; i < rotating_; ++i) {
    double turned = 2.0 * radius_of_gyration_[i];
    if (is_of_rates) {
      const Eigen::Vector3d rate =
          kinematics_.inverse_inertia()[i] * ConstVector(dy + layout().L_at + 3 * i);
      const double moved = h * radius_of_gyration_[i];
      consider(moved * moved * rate.squaredNorm());
      turned *= std::min(1.0, h * kinematics_.angular_velocity()[i].norm());
    }
    const double norm = Eigen::Map<const Eigen::Vector4d>(dq + 4 * i).squaredNorm();
    consider(turned * turned * norm);
  }
  return largest;
}

// ---- projections

// Computes C of all rows. Returns the largest error of a row that is not redundant [m].
double EquationsOfMotion::find_values() {
  double worst = 0.0;
  redundant_.begin_errors();
  kinematics_.find_values(*this, inputs_, coordinates_, [&](std::size_t row, double error) {
    if (!redundant_.take_error(row, error)) worst = larger(worst, error);
  });
  return worst;
}

bool EquationsOfMotion::restore_redundant_if_off() {
  return redundant_.restore_if_off(placed_rows(), &delassus_, &forces_);
}

bool EquationsOfMotion::project(double t, double* y) {
  // An energy noted while no row was left out at the last restart() belongs to a rejected step.
  const bool is_known = energy_.is_known() && redundant_.was_passing();
  if (redundant_.came_back() && !is_known) note_energy(t, y);
  return fit_positions(t, y);
}

// Projects positions at the start of an interval, where no factors need be near. Redundant rows
// found to be needed get a force again, one or several at a time.
bool EquationsOfMotion::project_start(double t, double* y) {
  for (;;) {
    if (!delassus_.has_factors()) {
      place(t, y);
      factor(kLeastPivotOfProjections);
    }
    const std::size_t redundant = delassus_.redundant();
    if (fit_positions(t, y)) return true;
    if (delassus_.redundant() == redundant) return false;
  }
}

// Makes Newton steps with the factors of the last stage, and with new factors where those do not
// converge. Leaves kinematics evaluated at y.
bool EquationsOfMotion::fit_positions(double t, double* y) {
  const std::size_t bodies = bodies_.size();
  double* const q = y + layout().q_at;
  time_ = t;
  inputs_.update(*this, t);
  double before = kInfinity;
  double rounding = 0.0;
  bool factors_are_near = true;
  for (int i = 0;; ++i) {
    if (!normalize_quaternions(q, rotating_)) return false;
    kinematics_.place(*this, t, y, &inputs_);
    const double error = find_values();
    if (i == 0) rounding = kEpsilon * std::max(scale_, error);  // scale_ is 0 for a single point
    if (error <= rounding) return !restore_redundant_if_off();
    if (!(error <= 0.5 * before)) {
      if (error <= 16.0 * rounding) return !restore_redundant_if_off();
      if (!factors_are_near || !std::isfinite(error))
        return error <= kProjectionFailed * scale_ && !restore_redundant_if_off();
      factors_are_near = false;
      factor(kLeastPivotOfProjections);
    }
    if (i == kMostProjectionSteps)
      return error <= kProjectionFailed * scale_ && !restore_redundant_if_off();
    before = error;

    for (std::size_t r = 0; r < rows_.size(); ++r)
      solution_[delassus_.unknown()[r]] = -kinematics_.value()[r];
    delassus_.solve(solution_.data());
    delassus_.apply_transpose(*this, kinematics_, solution_.data());
    for (std::size_t k = 0; k < bodies; ++k)
      Vector(y + 3 * k) += inverse_mass_[k] * delassus_.force()[k];
    for (std::size_t k = 0; k < rotating_; ++k) {
      double rate[4];
      write_quaternion_rate(kinematics_.inverse_inertia()[k] * delassus_.torque()[k], q + 4 * k,
                            rate);
      for (std::size_t e = 0; e < 4; ++e) q[4 * k + e] += rate[e];
    }
  }
}

// Projects velocities after project(), and evaluates the derivative of the first stage with the
// same factors.
bool EquationsOfMotion::restart(double* y, double* dydt) {
  delassus_.keep_none();
  factor(kLeastPivotOfProjections);
  kinematics_.move(*this, inputs_, y);
  if (!rows_.empty()) {
    const double projected = projected_energy_;
    project_velocities(y);
    if (delassus_.redundant() > 0) {
      // Where rows are almost dependent, the kept rows determine the redundant rows only up to
      // rounding divided by the smallest pivot.
      if (choose_again(time_, y)) return project_start(time_, y) && restart(y, dydt);
      if (!redundant_rates_are_met()) return !redundant_.is_inconsistent() && restart(y, dydt);
    }
    if (delassus_.left_out() > 0 && !prescribed_rates_are_met()) {
      redundant_.set_inconsistent(true);
      return false;
    }
    note_left_out();
    redundant_.set_came_back(false);
    if (energy_.is_known() && energy_.restore(*this, inputs_, kinematics_, scale_, y)) {
      kinematics_.move(*this, inputs_, y);
      projected_energy_ = projected;
    }
    energy_.forget();
    if (delassus_.left_out() > 0) note_energy(time_, y);
  }
  if (delassus_.left_out() > 0) factor(kLeastPivotOfForces);
  if (!coordinates_.empty()) coordinates_.note(*this, inputs_, kinematics_);
  accelerate(0, y, dydt);
  return true;
}

// Changes the velocities in y by impulses along the rows, so that each rate Ċ has its target. Adds
// the impulses to those of the joints, and the energy that they take to projected_energy_.
void EquationsOfMotion::project_velocities(double* y) {
  const List<std::size_t>& unknown = delassus_.unknown();
  const List<double>& target = inputs_.rate_target();
  const List<double>& rate = kinematics_.rate();
  kinematics_.find_rates(*this);
  for (std::size_t i = 0; i < rows_.size(); ++i) solution_[unknown[i]] = target[i] - rate[i];
  delassus_.solve(solution_.data());
  delassus_.apply_transpose(*this, kinematics_, solution_.data());
  for (std::size_t k = 0; k < bodies_.size(); ++k)
    Vector(y + layout().v_at + 3 * k) += inverse_mass_[k] * delassus_.force()[k];
  for (std::size_t k = 0; k < rotating_; ++k)
    Vector(y + layout().L_at + 3 * k) += delassus_.torque()[k];
  for (std::size_t i = 0; i < rows_.size(); ++i)
    projected_energy_ += 0.5 * solution_[unknown[i]] * (target[i] - rate[i]);
  delassus_.multipliers_to_forces(*this, inputs_, solution_.data());
  for (std::size_t i = 0; i < rows_.size(); ++i) forces_.impulses()[i] += solution_[i];
  kinematics_.move(*this, inputs_, y);
}

bool EquationsOfMotion::rates_are_met(double t, const double* y) {
  place(t, y);
  kinematics_.move(*this, inputs_, y);
  kinematics_.find_rates(*this);
  for (const auto& [l, motion] : inputs_.motions()) {
    if (!is_rod(l)) continue;
    const Prescribed& length = inputs_.length()[l];
    const double off = (kinematics_.rate()[l] - inputs_.rate_target()[l]) / length.value;
    const double speed =
        std::max(std::abs(length.rate), kinematics_.separation_rate(*this, l).norm());
    if (std::abs(off) > kRodRatesMet * speed + 16.0 * kEpsilon * scale_) return false;
  }
  return true;
}

// Whether the velocities meet the rates that prescribed motions demand; rows may contradict each
// other.
bool EquationsOfMotion::prescribed_rates_are_met() {
  kinematics_.find_rates(*this);
  if (!inputs_.is_time_dependent()) return true;
  const double most = kLeftOutRatesAgree * kinematics_.largest_speed(*this);
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    const double off = std::abs(kinematics_.rate()[i] - inputs_.rate_target()[i]);
    if (!redundant_.is_redundant()[i] && off > most * inputs_.row_length(*this, i)) return false;
  }
  return true;
}

bool EquationsOfMotion::redundant_rates_are_met() {
  if (!redundant_.are_rates_known(delassus_)) return true;
  kinematics_.find_rates(*this);
  return redundant_.rates_are_met(placed_rows(), &delassus_, &forces_);
}

int EquationsOfMotion::choose_rows(double t, const double* y) {
  place(t, y);
  return redundant_.choose(placed_rows(), &delassus_, &forces_);
}

// Chooses the rows again where that is due. Returns whether it did.
bool EquationsOfMotion::choose_again(double t, const double* y) {
  redundant_.end_rejections();
  if (!redundant_.is_choice_due(placed_rows(), delassus_)) return false;
  choose_rows(t, y);
  find_values();
  redundant_.limit(placed_rows(), delassus_);
  return true;
}

void EquationsOfMotion::note_left_out() {
  if (delassus_.left_out() == 0) return redundant_.note_none_left_out();
  kinematics_.find_rates(*this);
  redundant_.note_left_out(placed_rows(), delassus_, substep_);
}

void EquationsOfMotion::note_energy(double t, const double* y) {
  energy_.forget();
  if (!conserves_energy(*this, inputs_)) return;
  place(t, y);
  energy_.note(*this, inputs_, kinematics_, y);
}

}  // namespace constraint_sim::engine
