#include "engine/methods/equations_of_motion.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "engine/methods/embedded_pairs.h"
#include "engine/methods/quaternion_state.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using ConstVector = Eigen::Map<const Vector3d>;
using Vector = Eigen::Map<Vector3d>;

constexpr double kEpsilon = std::numeric_limits<double>::epsilon();
constexpr std::size_t kMostStages = DormandPrince8::kStages + 1;

// Rows are left out whose pivot falls below these shares of their diagonal entry: of forces, and of
// both projections. Near a singular pose, passed at speed v with an error ε and an acceleration a
// across, these lose the least energy: y³ = ε v²/a, p ~ y².
constexpr double kLeastPivotOfForces = 3e-11;
constexpr double kLeastPivotOfProjections = 1e-9;

// Rows left out are passed at velocities that are off by no more than the square root of their
// pivot.
constexpr double kRatesAgree = 1e-4;  // of the largest speed
constexpr int kMostNewtonSteps = 8;
constexpr double kProjected = 1e-10;  // of the scene's size: more is no solution

std::size_t at(int i) { return static_cast<std::size_t>(i); }

// without the call that std::copy is, for a few numbers
void copy(const double* from, std::size_t n, double* to) {
  const auto size = static_cast<Eigen::Index>(n);
  Eigen::VectorXd::Map(to, size) = Eigen::VectorXd::Map(from, size);
}

}  // namespace

// ---- what is compiled

EquationsOfMotion::EquationsOfMotion(std::vector<int> joints, const std::vector<Joint>& all_joints,
                                     const Ends& ends, const std::vector<MassProperties>& masses,
                                     const std::vector<CoupledTerms>& couplings,
                                     const std::vector<int>& idle)
    : joints_(std::move(joints)) {
  find_bodies(all_joints, ends, masses, idle);
  const bool is_in_line = order_as_chain(all_joints, ends, masses);
  is_chain_ = is_in_line && turning_ == 0;
  is_chain_of_bodies_ = is_in_line && turning_ > 0;
  for (const int body : bodies_) inverse_mass_.push_back(masses[at(body)].inverse_mass);
  for (std::size_t i = 0; i < turning_; ++i) {
    inertia_.push_back(masses[at(bodies_[i])].inertia);
    radius_of_gyration_.push_back(masses[at(bodies_[i])].radius_of_gyration());
  }
  const auto even = [](std::size_t n) { return n + n % 2; };
  v_at_ = even(3 * bodies_.size());
  q_at_ = 2 * v_at_;
  L_at_ = q_at_ + 4 * turning_;
  size_ = even(L_at_ + 3 * turning_);
  add_links(all_joints, ends, masses, couplings);
  for (auto* list : {&is_redundant_, &is_needed_, &is_verified_}) list->assign(rows_.size(), 0);
  for (auto* list : {&imbalance_, &redundant_off_}) list->assign(rows_.size(), 0.0);
  couple_rows();
  find_branches();

  if (is_chain_) tridiagonal_.resize(rows_.size());
  if (is_chain_of_bodies_) mirror_chain();
  find_tree();

  const std::size_t points = inverse_mass_.size();
  for (auto* list : {&position_, &velocity_, &acceleration_, &push_, &load_acceleration_})
    list->assign(points, Vector3d::Zero());
  orientation_.resize(turning_);
  inverse_inertia_.resize(turning_);
  for (auto* list : {&spin_, &spin_acceleration_, &torque_, &twist_, &load_torque_})
    list->assign(turning_, Vector3d::Zero());
  for (auto* list : {&d_, &arm_a_, &arm_b_}) list->assign(links_.size(), Vector3d::Zero());
  length_.resize(links_.size());
  is_changing_.assign(links_.size(), false);
  courses_.reserve(links_.size());
  for (auto* list : {&value_, &rate_, &value_target_, &rate_target_, &acceleration_target_,
                     &solution_, &residual_, &stress_})
    list->assign(rows_.size(), 0.0);
  turn_.assign(turns_.size(), Vector3d::Zero());
  turn_response_ = turn_;
  impulses_.assign(soft_force(softs_.size()), 0.0);
  squares_.assign(bodies_.size(), 0.0);
  stage_forces_.assign(impulses_.size() * kMostStages, 0.0);
  kept_positions_.reserve(softs_.size() + 2 * coupled_.size());
}

// ---- a span of time in which nothing jumps

void EquationsOfMotion::load(const std::vector<BodyState>& states, double* y) const {
  double* v = y + v_at_;
  double* q = y + q_at_;
  double* L = y + L_at_;
  for (std::size_t i = 0; i < bodies_.size(); ++i) {
    const BodyState& state = states[at(bodies_[i])];
    Vector(y + 3 * i) = state.position;
    Vector(v + 3 * i) = state.linear_velocity;
    if (!turns(i)) continue;
    Eigen::Map<Eigen::Vector4d>(q + 4 * i) = state.orientation.coeffs();
    Vector(L + 3 * i) = apply_inertia(inertia_[i], state.orientation, state.angular_velocity);
  }
}

void EquationsOfMotion::store(const double* y, std::vector<BodyState>* states) {
  scale_ = std::max(fixed_scale_, largest_coordinate(y));
  const double* v = y + v_at_;
  const double* q = y + q_at_;
  const double* L = y + L_at_;
  for (std::size_t i = 0; i < bodies_.size(); ++i) {
    BodyState& state = (*states)[at(bodies_[i])];
    state.position = ConstVector(y + 3 * i);
    state.linear_velocity = ConstVector(v + 3 * i);
    if (!turns(i)) continue;
    state.orientation.coeffs() = Eigen::Map<const Eigen::Vector4d>(q + 4 * i);
    state.angular_velocity =
        apply_inertia(inertia_[i].cwiseInverse(), state.orientation, ConstVector(L + 3 * i));
  }
}

void EquationsOfMotion::begin(double t, const std::vector<BodyState>& states,
                              const Vector3d& gravity, const std::vector<Load>& loads,
                              const std::vector<JointCourse>& courses, double since_tick) {
  std::fill_n(load_acceleration_.begin(), bodies_.size(), gravity);
  for (Vector3d& torque : load_torque_) torque.setZero();
  for (const Load& load : loads) {
    const auto found = std::find(bodies_.begin(), bodies_.end(), load.body);
    if (found == bodies_.end()) continue;
    const auto i = static_cast<std::size_t>(found - bodies_.begin());
    load_acceleration_[i] += inverse_mass_[i] * load.force;
    if (turns(i)) load_torque_[i] += load.torque;
  }

  tick_start_ = t - since_tick;
  noted_at_ = t;
  fixed_points_move_ = false;
  for (FixedPoint& point : fixed_points_) {
    point.start = states[at(point.body)];
    fixed_points_move_ = fixed_points_move_ || !point.start.linear_velocity.isZero(0.0) ||
                         !point.start.angular_velocity.isZero(0.0);
  }
  fixed_scale_ = 0.0;

  has_jumped_ = rates_jump(courses);
  courses_.clear();
  std::fill(rate_target_.begin(), rate_target_.end(), 0.0);
  std::fill(acceleration_target_.begin(), acceleration_target_.end(), 0.0);
  for (std::size_t l = 0; l < links_.size(); ++l) {
    const JointCourse& course = courses[at(joints_[l])];
    if (is_changing_[l] == course.is_constant()) {
      has_jumped_ = true;
      has_chosen_ = false;
    }
    is_changing_[l] = !course.is_constant();
    if (is_changing_[l]) courses_.emplace_back(l, course);
    length_[l] = is_by_offset(l) ? Course{} : course.length(t);
    fixed_scale_ = std::max(fixed_scale_, length_[l].value);
    if (is_general(l)) {
      if (course.moves_frame())
        set_frame(l, course.frame(t, links_[l].anchor_b, links_[l].frame_b));
      else if (frame_b(l).moves)
        set_frame(l, {links_[l].anchor_b, links_[l].frame_b});
      fixed_scale_ = std::max(fixed_scale_, links_[l].radius);
      if (couples(links_[l].kind)) ask_coupled(l, course, t);
      for (std::size_t k = 0; k < rows_of(l); ++k) {
        double& target = value_target_[first_row(l) + k];
        target = course.target(links_[l].function[k], t).value;
        if (links_[l].function[k] >= info(links_[l].kind).rows)
          fixed_scale_ = std::max(fixed_scale_, std::abs(target) / row_length(first_row(l) + k));
      }
    }
    if (turns(links_[l].a)) fixed_scale_ = std::max(fixed_scale_, links_[l].anchor_a.norm());
    if (turns(links_[l].b)) fixed_scale_ = std::max(fixed_scale_, links_[l].anchor_b.norm());
  }
  for (const CoupledRow& coupled : coupled_)
    for (const CoupledRow::Term& term : coupled.terms)
      fixed_scale_ = std::max(fixed_scale_, coupled.metres * std::abs(term.ratio * term.position));
  place_fixed_points(t);
  for (std::size_t p = bodies_.size(); p < position_.size(); ++p)
    fixed_scale_ = std::max(fixed_scale_, position_[p].cwiseAbs().maxCoeff());
}

// Whether a motor asks for another rate from t on than until then, since its time is over or it was
// set anew while another one, or a sinusoid, goes on.
bool EquationsOfMotion::rates_jump(const std::vector<JointCourse>& courses) const {
  for (const auto& [l, before] : courses_)
    if (!courses[at(joints_[l])].is_driven_as(before)) return true;
  return false;
}

double EquationsOfMotion::largest_coordinate(const double* y) const {
  return Eigen::VectorXd::Map(y, static_cast<Eigen::Index>(3 * bodies_.size()))
      .cwiseAbs()
      .maxCoeff();
}

bool EquationsOfMotion::rates_keep_pace(double t, const double* y) {
  ask(t);
  place(t, y);
  set_velocities(y);
  find_rates();
  for (const auto& [l, course] : courses_) {
    if (!is_rod(l)) continue;
    const double off = (rate_[l] - rate_target_[l]) / length_[l].value;
    const double speed = std::max(std::abs(length_[l].rate), d_dot(l).norm());
    if (std::abs(off) > 1e-12 * speed + 16.0 * kEpsilon * scale_) return false;
  }
  return true;
}

bool EquationsOfMotion::start(double t, double* y, double* dydt) {
  scale_ = std::max(fixed_scale_, largest_coordinate(y));
  is_inconsistent_ = false;
  time_ = t;
  if (has_chosen_) return meet(t, y) && restart(y, dydt);
  // some mechanisms are redundant only where the joints are met
  const int not_yet = choose_rows(t, y);
  if (!meet(t, y)) return false;
  if (not_yet > 0) {
    choose_rows(t, y);
    if (!meet(t, y)) return false;
  }
  return limit_redundant_rows() && restart(y, dydt);
}

// project() at the start of a span, where no factors need be near. Rows that are needed after all
// come back one or several at a time.
bool EquationsOfMotion::meet(double t, double* y) {
  for (;;) {
    if (!factors_are_there_) {
      ask(t);
      place(t, y);
      factor(kLeastPivotOfProjections);
    }
    const std::size_t redundant = redundant_rows();
    if (project(t, y)) return true;
    if (redundant_rows() == redundant) return false;
  }
}

void EquationsOfMotion::begin_step(const std::vector<JointState>& states) {
  for (SoftCoordinate& soft : softs_) {
    const auto i = at(soft.function - info(links_[soft.link].kind).rows);
    const CoordinateState& state = states[at(joints_[soft.link])].coordinates[i];
    soft.position = state.position;
  }
  for (CoupledRow& coupled : coupled_) {
    coupled.constant = states[at(joints_[coupled.link])].coupling.constant;
    for (CoupledRow::Term& term : coupled.terms)
      term.position = states[at(joints_[term.link])].coordinates[at(term.coordinate)].position;
  }
  std::fill(impulses_.begin(), impulses_.end(), 0.0);
  dependent_rows_ = 0;
  momentary_error_ = 0.0;
}

RowVector EquationsOfMotion::of_rows(std::size_t l, const double* of_unknowns) const {
  RowVector rows = RowVector::Zero();
  if (!is_by_offset(l)) {
    rows[0] = of_unknowns[is_rod(l) ? rows_[l].unknown : rows_.size() + l - first_spring_];
    return rows;
  }
  const std::size_t first = first_row(l);
  for (std::size_t k = 0; k < rows_of(l); ++k)
    rows[static_cast<Eigen::Index>(k)] = of_unknowns[rows_[first + k].unknown];
  return rows;
}

RowVector EquationsOfMotion::row_impulse(std::size_t l) const {
  return of_rows(l, impulses_.data());
}

RowVector EquationsOfMotion::by_function(std::size_t l, const RowVector& of_rows,
                                         const double* of_unknowns) const {
  if (!is_general(l)) return of_rows;
  RowVector sorted = RowVector::Zero();
  const Link& link = links_[l];
  for (int k = 0; k < link.rows; ++k) sorted[link.function[at(k)]] = of_rows[k];
  for (std::size_t s = link.first_soft; s < link.first_soft + link.softs; ++s)
    sorted[softs_[s].function] += of_unknowns[soft_force(s)];
  return sorted;
}

RowVector EquationsOfMotion::by_joint(std::size_t l, const double* of_unknowns) const {
  return by_function(l, of_rows(l, of_unknowns), of_unknowns);
}

RowVector EquationsOfMotion::impulse(std::size_t l) const { return by_joint(l, impulses_.data()); }

// ---- for methods that step in their own way

RowVector EquationsOfMotion::offset(std::size_t of) const {
  if (is_general(of)) {
    RowVector targets = RowVector::Zero();
    for (std::size_t k = 0; k < rows_of(of); ++k)
      targets[static_cast<Eigen::Index>(k)] = value_target_[first_row(of) + k];
    return targets;
  }
  for (const auto& [l, course] : courses_)
    if (l == of) return length_[l].value * course.offset();
  return RowVector::Zero();
}

RowVector EquationsOfMotion::driven_rate(std::size_t of, double t) const {
  RowVector rates = RowVector::Zero();
  for (const auto& [l, course] : courses_)
    for (std::size_t k = 0; l == of && k < rows_of(l); ++k)
      rates[static_cast<Eigen::Index>(k)] = course.driven_rate(links_[l].function[k], t);
  return rates;
}

Vector3d EquationsOfMotion::body_velocity(std::size_t fixed_point, double t) const {
  const BodyState& body = fixed_points_[fixed_point - bodies_.size()].start;
  const Vector3d centre = body.position + (t - tick_start_) * body.linear_velocity;
  return body.linear_velocity + body.angular_velocity.cross(position_[fixed_point] - centre);
}

void EquationsOfMotion::read_pose(const std::vector<Vector3d>& positions,
                                  const std::vector<Quaterniond>& orientations) {
  pose_.resize(size());
  for (std::size_t i = 0; i < bodies_.size(); ++i) Vector(pose_.data() + 3 * i) = positions[i];
  for (std::size_t i = 0; i < turning_; ++i)
    Eigen::Map<Eigen::Vector4d>(pose_.data() + q_at_ + 4 * i) = orientations[i].coeffs();
}

bool EquationsOfMotion::find_dependent(double t, const std::vector<Vector3d>& positions,
                                       const std::vector<Quaterniond>& orientations, double least,
                                       std::vector<char>* rows) {
  read_pose(positions, orientations);
  ask(t);
  place(t, pose_.data());
  factor(least);
  factors_are_there_ = false;
  if (is_choice_due()) {
    find_values();
    if (redundant_rows_are_off()) return false;  // never choose where rows are off
    choose_again(t, pose_.data());
    factor(least);
    factors_are_there_ = false;
  }
  rows->assign(rows_.size(), 0);
  for (std::size_t i = 0; i < rows_.size(); ++i)
    (*rows)[i] =
        is_redundant_[i] ? kRedundant : (ldlt_.is_left_out(rows_[i].unknown) ? kMomentary : '\0');
  dependent_rows_ = std::max(dependent_rows_, left_out_);
  return true;
}

void EquationsOfMotion::add_impulse(std::size_t l, const RowVector& impulse) {
  if (is_by_offset(l)) {
    for (std::size_t k = 0; k < rows_of(l); ++k)
      impulses_[rows_[first_row(l) + k].unknown] += impulse[static_cast<Eigen::Index>(k)];
  } else {
    impulses_[is_rod(l) ? rows_[l].unknown : rows_.size() + l - first_spring_] += impulse[0];
  }
}

void EquationsOfMotion::keep_impulses() {
  kept_impulses_ = impulses_;
  kept_positions_.clear();
  for (const SoftCoordinate& soft : softs_) kept_positions_.push_back(soft.position);
  for (const CoupledRow& coupled : coupled_)
    for (const CoupledRow::Term& term : coupled.terms) kept_positions_.push_back(term.position);
}

void EquationsOfMotion::restore_impulses() {
  impulses_ = kept_impulses_;
  const double* kept = kept_positions_.data();
  for (std::size_t s = 0; s < softs_.size(); ++s) set_position(s, *kept++);
  for (std::size_t c = 0; c < coupled_.size(); ++c)
    for (std::size_t k = 0; k < 2; ++k) set_position(c, k, *kept++);
}

bool EquationsOfMotion::count_turns(std::size_t l,
                                    std::array<double, kMaxCoordinates>* positions) const {
  const Link& link = links_[l];
  if (!is_general(l) || (link.softs == 0 && coupled_.empty())) return false;
  positions->fill(std::numeric_limits<double>::quiet_NaN());
  for (std::size_t s = link.first_soft; s < link.first_soft + link.softs; ++s)
    (*positions)[at(softs_[s].function - info(link.kind).rows)] = softs_[s].position;
  for (const CoupledRow& coupled : coupled_)
    for (const CoupledRow::Term& term : coupled.terms)
      if (term.link == l) (*positions)[at(term.coordinate)] = term.position;
  return true;
}

double EquationsOfMotion::frequency() {
  if (is_tree()) place_general_rows();
  const double* const forces = stage_forces_.data();
  std::fill(squares_.begin(), squares_.end(), 0.0);
  for (std::size_t l = 0; l < links_.size(); ++l) {
    const Link& link = links_[l];
    double force = 0.0, across = 0.0;
    if (is_general(l)) continue;
    if (is_ball(l)) {
      for (std::size_t k = 0; k < 3; ++k)
        force = std::hypot(force, forces[rows_[first_row(l) + k].unknown]);
    } else {
      force = std::abs(forces[is_rod(l) ? rows_[l].unknown : rows_.size() + l - first_spring_]);
      const double distance = is_rod(l) ? length_[l].value : d_[l].norm();
      across = force / std::max(distance, 1e-9 * scale_);
    }
    for (const auto& [point, anchor] :
         {std::pair(link.a, link.anchor_a), {link.b, link.anchor_b}}) {
      if (point >= bodies_.size()) continue;
      squares_[point] += 2.0 * across * inverse_mass_[point];
      if (turns(point)) squares_[point] += force * anchor.norm() / inertia_[point].minCoeff();
    }
  }
  for (std::size_t s = 0; s < softs_.size(); ++s) {
    const Link& link = links_[softs_[s].link];
    const Jacobian J = jacobian(softs_[s].form, vectors_[softs_[s].link - first_general_]);
    const double force = std::abs(forces[soft_force(s)]);
    for (const auto& [point, torque] : {std::pair(link.a, J.j2), {link.b, J.j4}})
      if (turns(point)) squares_[point] += force * torque.norm() / inertia_[point].minCoeff();
  }
  for (std::size_t i = first_general_row(); i < parts(); ++i) {
    const double force = std::abs(forces[rows_[row_of_part(i)].unknown]);
    for (const int turn : {part(i).turn_a, part(i).turn_b}) {
      if (turn < 0) continue;
      const std::size_t body = turns_[at(turn)].body;
      squares_[body] += force * turn_[at(turn)].norm() / inertia_[body].minCoeff();
    }
  }
  return std::sqrt(*std::max_element(squares_.begin(), squares_.end()));
}

double EquationsOfMotion::kinetic_energy(const double* y) const {
  const double* const v = y + v_at_;
  const double* const q = y + q_at_;
  const double* const L = y + L_at_;
  double energy = 0.0;
  for (std::size_t i = 0; i < bodies_.size(); ++i)
    energy += 0.5 / inverse_mass_[i] * ConstVector(v + 3 * i).squaredNorm();
  for (std::size_t i = 0; i < turning_; ++i) {
    const Vector3d in_body = rotation_matrix(q + 4 * i).transpose() * ConstVector(L + 3 * i);
    energy += 0.5 * in_body.dot(in_body.cwiseQuotient(inertia_[i]));
  }
  return energy;
}

// ---- one evaluation

// lengths and offsets at t, of the links where they change
void EquationsOfMotion::ask(double t) {
  for (const auto& [l, course] : courses_) {
    if (is_rod(l)) {
      const Course length = length_[l] = course.length(t);
      rate_target_[l] = length.value * length.rate;
      acceleration_target_[l] = length.rate * length.rate + length.value * length.acceleration;
      continue;
    }
    if (l >= first_spring_) {
      length_[l] = course.length(t);
      continue;
    }
    const Course share = length_[l] = course.share_to_close(t);
    if (couples(links_[l].kind)) ask_coupled(l, course, t);
    if (course.moves_frame()) set_frame(l, course.frame(t, links_[l].anchor_b, links_[l].frame_b));
    for (std::size_t k = 0; is_general(l) && k < rows_of(l); ++k) {
      const Course target = course.target(links_[l].function[k], t);
      value_target_[first_row(l) + k] = target.value;
      rate_target_[first_row(l) + k] = target.rate;
      acceleration_target_[first_row(l) + k] = target.acceleration;
    }
    for (std::size_t k = 0; is_ball(l) && k < rows_of(l); ++k) {
      const double offset = course.offset()[static_cast<Eigen::Index>(k)];
      rate_target_[first_row(l) + k] = offset * share.rate;
      acceleration_target_[first_row(l) + k] = offset * share.acceleration;
    }
  }
}

void EquationsOfMotion::set_frame(std::size_t l, const MovingFrame& frame) {
  frames_[l - first_general_] = frame;
  const std::size_t b = links_[l].b;
  if (b < bodies_.size()) return;
  FixedPoint& point = fixed_points_[b - bodies_.size()];
  point.anchor = frame.anchor;
  point.anchor_rate = frame.anchor_rate;
  point.anchor_acceleration = frame.anchor_acceleration;
  fixed_points_move_ = fixed_points_move_ || frame.moves;
}

// what does not hang on the state
void EquationsOfMotion::move_with_time(double t) {
  ask(t);
  if (fixed_points_move_) place_fixed_points(t);
}

void EquationsOfMotion::place(double t, const double* y) {
  placed_at_ = t;
  place_bodies(y);
  if (fixed_points_move_) place_fixed_points(t);
  place_links();
  if (turning_ > 0) place_arms();
  if (first_general_ < first_spring_) place_general();
}

void EquationsOfMotion::place_bodies(const double* y) {
  copy(y, 3 * bodies_.size(), position_.front().data());
  const double* q = y + q_at_;
  for (std::size_t i = 0; i < turning_; ++i) {
    const Matrix3d R = rotation_matrix(q + 4 * i);
    orientation_[i] = R;
    inverse_inertia_[i].noalias() = R * inertia_[i].cwiseInverse().asDiagonal() * R.transpose();
  }
}

void EquationsOfMotion::place_fixed_points(double t) {
  for (std::size_t i = 0; i < fixed_points_.size(); ++i) {
    const FixedPoint& point = fixed_points_[i];
    const std::size_t p = bodies_.size() + i;
    const double since = t - tick_start_;
    const Vector3d& w = point.start.angular_velocity;
    const Quaterniond turned = rotation(since * w) * point.start.orientation;
    const Vector3d arm = turned * point.anchor;
    const Vector3d around = w.cross(arm);
    position_[p] = point.start.position + since * point.start.linear_velocity + arm;
    velocity_[p] = point.start.linear_velocity + around;
    load_acceleration_[p] = w.cross(around);
    if (!point.anchor_rate.isZero(0.0) || !point.anchor_acceleration.isZero(0.0)) {
      const Vector3d rate = turned * point.anchor_rate;
      velocity_[p] += rate;
      load_acceleration_[p] += 2.0 * w.cross(rate) + turned * point.anchor_acceleration;
    }
    if (point.has_axes)
      fixed_axes_[i] = (rotation(since * w) * point.start.orientation).toRotationMatrix();
  }
}

// d, for now from centre to centre where an end turns
void EquationsOfMotion::place_links() {
  for (std::size_t l = 0; l < first_ball_; ++l)
    direction_[l] = position_[links_[l].b] - position_[links_[l].a];
  for (std::size_t l = first_ball_; l < links_.size(); ++l)
    d_[l] = position_[links_[l].b] - position_[links_[l].a];
}

void EquationsOfMotion::place_arms() {
  const auto place_arm = [&](std::size_t l, const Vector3d& anchor_b) {
    const Link& link = links_[l];
    Vector3d& d = is_rod(l) ? direction_[l] : d_[l];
    if (turns(link.a)) d -= arm_a_[l] = orientation_[link.a] * link.anchor_a;
    if (turns(link.b)) d += arm_b_[l] = orientation_[link.b] * anchor_b;
  };
  for (std::size_t l = first_general_; l < first_spring_; ++l) place_arm(l, frame_b(l).anchor);
  for (std::size_t l = first_spring_; l < links_.size(); ++l) place_arm(l, links_[l].anchor_b);
  for (std::size_t l = first_armed_; l < first_general_; ++l) {
    if (!links_[l].has_arms) continue;
    place_arm(l, links_[l].anchor_b);
    const std::size_t begin = is_rod(l) ? l : first_row(l);
    const std::size_t end = is_rod(l) ? l + 1 : begin + 3;
    for (std::size_t i = begin; i < end; ++i) {
      const Row& row = rows_[i];
      if (row.turn_a >= 0) turn_[at(row.turn_a)] = direction_[i].cross(arm_a_[l]);
      if (row.turn_b >= 0) turn_[at(row.turn_b)] = arm_b_[l].cross(direction_[i]);
    }
  }
  for (std::size_t p = 0; p < turns_.size(); ++p)
    turn_response_[p].noalias() = inverse_inertia_[turns_[p].body] * turn_[p];
}

// A = G M⁻¹ Gᵀ here
void EquationsOfMotion::find_matrix() {
  std::vector<double>& A = ldlt_.values();
  std::fill(A.begin(), A.end(), 0.0);
  for (std::size_t i = 0; i < rows_.size(); ++i)
    if (!is_redundant_[i])
      A[rows_[i].diagonal] = rows_[i].inverse_mass * direction_[i].squaredNorm();
  for (std::size_t i = rows_.size(); i < parts(); ++i)
    if (!is_redundant_[row_of_part(i)])
      A[rows_[row_of_part(i)].diagonal] += part(i).inverse_mass * direction_[i].squaredNorm();
  for (const LinearCoupling& c : linear_couplings_)
    A[c.slot] += c.inverse_mass * direction_[c.i].dot(direction_[c.j]);
  for (const AngularCoupling& c : angular_couplings_)
    A[c.slot] += turn_[c.p].dot(turn_response_[c.q]);
}

void EquationsOfMotion::factor(double least) {
  if (rows_.empty()) return;
  find_matrix();
  left_out_ = ldlt_.factor(least);
  if (left_out_ > 0 && has_chosen_) verify_left_out(least);
  factors_are_there_ = true;
}

void EquationsOfMotion::set_velocities(const double* y) {
  copy(y + v_at_, 3 * bodies_.size(), velocity_.front().data());
  const double* L = y + L_at_;
  for (std::size_t i = 0; i < turning_; ++i) {
    const ConstVector momentum(L + 3 * i);
    spin_[i].noalias() = inverse_inertia_[i] * momentum;
    spin_acceleration_[i] = momentum.cross(spin_[i]);  // without torque, and times I⁻¹ to come
  }
  if (!motions_.empty()) move_general();
}

Vector3d EquationsOfMotion::d_dot(std::size_t l) const {
  const Link& link = links_[l];
  Vector3d rate = velocity_[link.b] - velocity_[link.a];
  if (!link.has_arms) return rate;
  if (turns(link.a)) rate -= spin_[link.a].cross(arm_a_[l]);
  if (turns(link.b)) rate += spin_[link.b].cross(arm_b_[l]);
  return rate;
}

Vector3d EquationsOfMotion::gamma_d(std::size_t l) const {
  const Link& link = links_[l];
  Vector3d gamma = Vector3d::Zero();
  if (turns(link.a)) gamma -= spin_[link.a].cross(spin_[link.a].cross(arm_a_[l]));
  if (turns(link.b)) gamma += spin_[link.b].cross(spin_[link.b].cross(arm_b_[l]));
  return gamma;
}

// the springs' forces, in addition to what acts without the rows
void EquationsOfMotion::pull_springs(double* forces) {
  std::copy(load_acceleration_.begin(), load_acceleration_.end(), acceleration_.begin());
  for (std::size_t l = first_spring_; l < links_.size(); ++l) {
    const Link& link = links_[l];
    const double distance = d_[l].norm();
    const Vector3d n = distance > 0.0 ? Vector3d(d_[l] / distance) : Vector3d(Vector3d::UnitX());
    const double stretch = distance - length_[l].value;
    const double rate = n.dot(d_dot(l)) - length_[l].rate;
    const double force = -link.stiffness * stretch - link.damping * rate;
    forces[rows_.size() + l - first_spring_] = force;
    const Vector3d f = force * n;
    acceleration_[link.a] -= inverse_mass_[link.a] * f;
    acceleration_[link.b] += inverse_mass_[link.b] * f;
    if (turns(link.a)) torque_[link.a] -= arm_a_[l].cross(f);
    if (turns(link.b)) torque_[link.b] += arm_b_[l].cross(f);
  }
}

// the same of what acts along coordinates
void EquationsOfMotion::pull_softs(double* forces) {
  if (first_spring_ == links_.size())
    std::copy(load_acceleration_.begin(), load_acceleration_.end(), acceleration_.begin());
  for (std::size_t s = 0; s < softs_.size(); ++s) {
    const SoftCoordinate& soft = softs_[s];
    const Link& link = links_[soft.link];
    const JointVectors& vectors = vectors_[soft.link - first_general_];
    const double force = forces[soft_force(s)] =
        soft.law.force(reading_of(soft), rate_of(soft.link, soft.form));
    const Jacobian J = jacobian(soft.form, vectors);
    acceleration_[link.a] += inverse_mass_[link.a] * force * J.j1;
    acceleration_[link.b] += inverse_mass_[link.b] * force * J.j3;
    if (turns(link.a)) torque_[link.a] += force * J.j2;
    if (turns(link.b)) torque_[link.b] += force * J.j4;
  }
}

// where a coordinate reads: angles near to where they go at the rate that was noted
double EquationsOfMotion::reading_of(const SoftCoordinate& soft) const {
  const double there = value(soft.form, vectors_[soft.link - first_general_]);
  return reading(soft.form, there, soft.zero, soft.position + (placed_at_ - noted_at_) * soft.rate);
}

// where coordinates read and how fast they go, that angles go on from
void EquationsOfMotion::note_positions() {
  for (SoftCoordinate& soft : softs_) {
    soft.position = reading_of(soft);
    soft.rate = rate_of(soft.link, soft.form);
  }
  for (CoupledRow& coupled : coupled_) {
    for (CoupledRow::Term& term : coupled.terms) {
      term.position = reading_of(term);
      term.rate = rate_of(term.link, term.form);
    }
  }
  noted_at_ = placed_at_;
}

// C̈_target − γ − G a_free
void EquationsOfMotion::find_right_hand_side(const Vector3d* free, double* b) const {
  for (std::size_t l = 0; l < first_armed_; ++l) {
    const Row& row = rows_[l];
    const Vector3d d_dot = velocity_[row.b] - velocity_[row.a];
    b[row.unknown] = -d_dot.squaredNorm() - direction_[l].dot(free[row.b] - free[row.a]);
  }
  for (std::size_t l = first_armed_; l < first_ball_; ++l) {
    const Row& row = rows_[l];
    const Vector3d a = free[row.b] - free[row.a] + gamma_d(l);
    b[row.unknown] = -d_dot(l).squaredNorm() - direction_[l].dot(a);
  }
  for (std::size_t l = first_ball_; l < first_general_; ++l) {
    const Link& link = links_[l];
    Vector3d a = free[link.b] - free[link.a];
    if (link.has_arms) a += gamma_d(l);
    for (std::size_t k = 0; k < 3; ++k)
      b[rows_[first_row(l) + k].unknown] = -a[static_cast<Eigen::Index>(k)];
  }
  for (const GeneralRow& row : general_rows_) {
    const Row& of = rows_[row.row];
    const std::size_t g = row.link - first_general_;
    b[of.unknown] = -gamma(row.form, vectors_[g], motions_[g]) -
                    direction_[row.row].dot(free[of.b] - free[of.a]);
  }
  if (!coupled_.empty()) add_coupled_right_hand_side(free, b);
  for (std::size_t p = 0; p < turns_.size(); ++p)
    b[turns_[p].unknown] -= turn_[p].dot(spin_acceleration_[turns_[p].body]);
  if (courses_.empty()) return;
  for (std::size_t i = 0; i < rows_.size(); ++i) b[rows_[i].unknown] += acceleration_target_[i];
}

void EquationsOfMotion::accelerate(std::size_t stage, const double* y, double* dydt) {
  double* const lambda = stage_forces_.data() + stage * impulses_.size();
  std::copy(load_torque_.begin(), load_torque_.end(), torque_.begin());
  const Vector3d* free = load_acceleration_.data();  // what bodies do without the rows
  if (first_spring_ < links_.size()) {
    pull_springs(lambda);
    free = acceleration_.data();
  }
  if (!softs_.empty()) {
    pull_softs(lambda);
    free = acceleration_.data();
  }
  for (std::size_t i = 0; i < turning_; ++i)
    spin_acceleration_[i] = inverse_inertia_[i] * (torque_[i] + spin_acceleration_[i]);
  find_right_hand_side(free, lambda);
  solve(lambda);
  respond(lambda);
  weigh_by_length(lambda);

  const std::size_t bodies = bodies_.size();
  copy(y + v_at_, 3 * bodies, dydt);
  for (std::size_t i = 0; i < bodies; ++i)
    Vector(dydt + v_at_ + 3 * i) = free[i] + inverse_mass_[i] * push_[i];
  const double* q = y + q_at_;
  for (std::size_t i = 0; i < turning_; ++i) {
    write_quaternion_rate(spin_[i], q + 4 * i, dydt + q_at_ + 4 * i);
    Vector(dydt + L_at_ + 3 * i) = torque_[i] + twist_[i];
  }
}

// from λ of rods to their forces [N]
void EquationsOfMotion::weigh_by_length(double* lambda) const {
  for (std::size_t l = 0; l < first_ball_; ++l) lambda[rows_[l].unknown] *= length_[l].value;
}

void EquationsOfMotion::derivative(std::size_t stage, double t, const double* y, double* dydt) {
  ask(t);
  place(t, y);
  factor(kLeastPivotOfForces);
  set_velocities(y);
  accelerate(stage, y, dydt);
}

// ---- projections

// C of all rows; returns how far the worst is off that is not redundant [m]
double EquationsOfMotion::find_values() {
  double worst = 0.0;
  worst_redundant_ = 0.0;
  const auto consider = [&](std::size_t row, double error) {
    if (is_redundant_[row])
      worst_redundant_ = std::max(worst_redundant_, error / redundant_off_[row]);
    else if (!(error <= worst))
      worst = error;  // a NaN stays
  };
  for (std::size_t l = 0; l < first_ball_; ++l) {
    const double length = length_[l].value;
    value_[l] = 0.5 * (direction_[l].squaredNorm() - length * length);
    consider(l, std::abs(value_[l] / length));
  }
  for (std::size_t l = first_ball_; l < first_general_; ++l)
    Vector(value_.data() + first_row(l)) = d_[l];
  for (const GeneralRow& row : general_rows_) value_[row.row] = value_of(row);
  for (const auto& [l, course] : courses_)
    for (std::size_t k = 0; is_ball(l) && k < rows_of(l); ++k)
      value_[first_row(l) + k] -= length_[l].value * course.offset()[static_cast<Eigen::Index>(k)];
  const std::size_t first_general = first_general_row();
  for (std::size_t i = first_ball_; i < first_general; ++i) consider(i, std::abs(value_[i]));
  for (const CoupledRow& coupled : coupled_) {
    value_[coupled.row] = value_of(coupled);
    consider(coupled.row, coupled.metres * std::abs(value_[coupled.row]));
  }
  for (const GeneralRow& row : general_rows_)
    consider(row.row, row.metres * std::abs(value_[row.row]));
  return worst;
}

// C of a row; of an angle the whole turns do not count
double EquationsOfMotion::value_of(const GeneralRow& row) const {
  const double off = value(row.form, vectors_[row.link - first_general_]) - value_target_[row.row];
  return row.form.is_angle ? unwound(off, 0.0) : off;
}

// Ċ of all rows
void EquationsOfMotion::find_rates() {
  for (std::size_t l = 0; l < first_ball_; ++l) rate_[l] = direction_[l].dot(d_dot(l));
  for (std::size_t l = first_ball_; l < first_general_; ++l)
    Vector(rate_.data() + first_row(l)) = d_dot(l);
  for (const GeneralRow& row : general_rows_)
    rate_[row.row] =
        rate(row.form, vectors_[row.link - first_general_], motions_[row.link - first_general_]);
  for (const CoupledRow& coupled : coupled_) {
    rate_[coupled.row] = 0.0;
    for (const CoupledRow::Term& term : coupled.terms)
      rate_[coupled.row] += term.ratio * rate_of(term.link, term.form);
  }
}

// largest speed of a point that a joint holds [m/s]
double EquationsOfMotion::largest_speed() const {
  double speed = 0.0;
  for (const Vector3d& velocity : velocity_) speed = std::max(speed, velocity.norm());
  for (std::size_t l = 0; l < links_.size(); ++l) {
    if (turns(links_[l].a)) speed = std::max(speed, spin_[links_[l].a].norm() * arm_a_[l].norm());
    if (turns(links_[l].b)) speed = std::max(speed, spin_[links_[l].b].norm() * arm_b_[l].norm());
  }
  return speed;
}

// whether the velocities found are what time asks of the rows, which may contradict each other
bool EquationsOfMotion::moves_as_asked() {
  find_rates();
  if (!varies()) return true;
  const double most = kRatesAgree * largest_speed();
  for (std::size_t i = 0; i < rows_.size(); ++i)
    if (!is_redundant_[i] && std::abs(rate_[i] - rate_target_[i]) > most * row_length(i))
      return false;
  return true;
}

// Newton's steps with the factors of the last stage, which is near, or if these do not do with
// factors made here. Leaves everything placed at y.
bool EquationsOfMotion::project(double t, double* y) {
  const std::size_t bodies = bodies_.size();
  double* const q = y + q_at_;
  time_ = t;
  ask(t);
  double before = std::numeric_limits<double>::infinity();
  double rounding = 0.0;
  bool factors_are_near = true;
  for (int i = 0;; ++i) {
    for (std::size_t k = 0; k < turning_; ++k) Eigen::Map<Eigen::Vector4d>(q + 4 * k).normalize();
    place(t, y);
    const double error = find_values();
    if (i == 0) rounding = kEpsilon * std::max(scale_, error);  // a scale of 0 is that of a point
    if (error <= rounding) return !restore_redundant_if_off();
    if (!(error <= 0.5 * before)) {
      if (error <= 16.0 * rounding) return !restore_redundant_if_off();
      if (!factors_are_near || !std::isfinite(error))
        return error <= kProjected * scale_ && !restore_redundant_if_off();
      factors_are_near = false;
      factor(kLeastPivotOfProjections);
    }
    if (i == kMostNewtonSteps) return error <= kProjected * scale_ && !restore_redundant_if_off();
    before = error;

    for (std::size_t r = 0; r < rows_.size(); ++r) solution_[rows_[r].unknown] = -value_[r];
    solve(solution_.data());
    respond(solution_.data());
    for (std::size_t k = 0; k < bodies; ++k) Vector(y + 3 * k) += inverse_mass_[k] * push_[k];
    for (std::size_t k = 0; k < turning_; ++k) {
      double rate[4];
      write_quaternion_rate(inverse_inertia_[k] * twist_[k], q + 4 * k, rate);
      for (std::size_t e = 0; e < 4; ++e) q[4 * k + e] += rate[e];
    }
  }
}

// after project(): velocities, and the derivative of the first stage with the same factors
bool EquationsOfMotion::restart(double* y, double* dydt) {
  const std::size_t bodies = bodies_.size();
  ldlt_.keep_none();
  factor(kLeastPivotOfProjections);
  set_velocities(y);
  if (!rows_.empty()) {
    find_rates();
    for (std::size_t i = 0; i < rows_.size(); ++i)
      solution_[rows_[i].unknown] = rate_target_[i] - rate_[i];
    solve(solution_.data());
    respond(solution_.data());
    double* const v = y + v_at_;
    double* const L = y + L_at_;
    for (std::size_t k = 0; k < bodies; ++k) Vector(v + 3 * k) += inverse_mass_[k] * push_[k];
    for (std::size_t k = 0; k < turning_; ++k) Vector(L + 3 * k) += twist_[k];
    for (std::size_t i = 0; i < rows_.size(); ++i)
      projected_energy_ += 0.5 * solution_[rows_[i].unknown] * (rate_target_[i] - rate_[i]);
    weigh_by_length(solution_.data());
    for (std::size_t i = 0; i < rows_.size(); ++i) impulses_[i] += solution_[i];
    set_velocities(y);
    if (redundant_rows() > 0) {
      // other rows held those that were redundant no better than to rounding over small pivots
      if (choose_again(time_, y)) return meet(time_, y) && restart(y, dydt);
      if (!redundant_rates_are_met()) return !is_inconsistent_ && restart(y, dydt);
    }
    if (left_out_ > 0 && !moves_as_asked()) {
      is_inconsistent_ = true;
      return false;
    }
    note_left_out();
  }
  if (left_out_ > 0) factor(kLeastPivotOfForces);
  if (!softs_.empty() || !coupled_.empty()) note_positions();
  accelerate(0, y, dydt);
  return true;
}

double EquationsOfMotion::rounding() const { return 4.0 * kEpsilon * scale_; }

double EquationsOfMotion::squared_size_of(const double* dy, double h) const {
  const std::size_t bodies = bodies_.size();
  double largest = 0.0;
  const auto consider = [&](double square) {
    if (!(square <= largest)) largest = square;  // a NaN stays
  };
  for (std::size_t i = 0; i < bodies; ++i) {
    consider(ConstVector(dy + 3 * i).squaredNorm());
    consider(h * h * ConstVector(dy + v_at_ + 3 * i).squaredNorm());
  }
  const double* dq = dy + q_at_;
  for (std::size_t i = 0; i < turning_; ++i) {
    const double turned = 2.0 * radius_of_gyration_[i];
    const double norm = Eigen::Map<const Eigen::Vector4d>(dq + 4 * i).squaredNorm();
    consider(turned * turned * norm);
  }
  return largest;
}

// ---- the linear system

// Gᵀλ: what the rows do to points and to those that turn
void EquationsOfMotion::respond(const double* lambda) {
  std::size_t pull = 0;
  for (std::size_t i = 0; i < bodies_.size(); ++i) {
    Vector3d sum = Vector3d::Zero();
    for (; pull < pulls_end_[i]; ++pull)
      sum += pulls_[pull].sign * lambda[pulls_[pull].unknown] * direction_[pulls_[pull].row];
    push_[i] = sum;
  }
  for (Vector3d& twist : twist_) twist.setZero();
  for (std::size_t p = 0; p < turns_.size(); ++p)
    twist_[turns_[p].body] += lambda[turns_[p].unknown] * turn_[p];
}

// λ in place of b; 0 of rows without a force
void EquationsOfMotion::solve(double* b) {
  if (left_out_ > dependent_rows_) dependent_rows_ = left_out_;
  if (kept_ < value_.size()) clear_redundant(b);
  ldlt_.solve(b);
}

// b − A λ of all rows, redundant ones as well
void EquationsOfMotion::find_residual(const double* b, const double* lambda, double* residual) {
  respond(lambda);
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    const Row& row = rows_[i];
    const Vector3d a = inverse_mass_[row.b] * push_[row.b] - inverse_mass_[row.a] * push_[row.a];
    residual[row.unknown] = b[row.unknown] - direction_[i].dot(a);
  }
  for (std::size_t i = rows_.size(); i < parts(); ++i) {
    const Row& row = part(i);
    const Vector3d a = inverse_mass_[row.b] * push_[row.b] - inverse_mass_[row.a] * push_[row.a];
    residual[rows_[row_of_part(i)].unknown] -= direction_[i].dot(a);
  }
  for (std::size_t p = 0; p < turns_.size(); ++p)
    residual[turns_[p].unknown] -= turn_response_[p].dot(twist_[turns_[p].body]);
}

}  // namespace constraint_sim::engine
