// What EquationsOfMotion are compiled to: bodies, joints in their order, rows, and the entries that
// these have in the matrix; and the rows of joints of general kinds where the bodies are.

#include <algorithm>
#include <iterator>
#include <unordered_map>

#include "engine/methods/equations_of_motion.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

std::size_t at(int i) { return static_cast<std::size_t>(i); }

}  // namespace

// those that turn come first
void EquationsOfMotion::find_bodies(const std::vector<Joint>& all_joints, const Ends& ends,
                                    const std::vector<MassProperties>& masses,
                                    const std::vector<int>& idle) {
  std::vector<int> turning, others;
  const auto add = [&](std::size_t body, const Vector3d& anchor, bool has_axes) {
    if (!masses[body].is_movable()) return;
    const bool turns = (!anchor.isZero(0.0) || has_axes) && masses[body].can_turn();
    (turns ? turning : others).push_back(static_cast<int>(body));
  };
  for (const std::vector<int>* list : {static_cast<const std::vector<int>*>(&joints_), &idle}) {
    for (const int j : *list) {
      const Joint& joint = all_joints[at(j)];
      add(ends[at(j)].first, joint.anchor_a, info(joint.kind).has_frames);
      add(ends[at(j)].second, joint.anchor_b, info(joint.kind).alignment != Alignment::kFree);
    }
  }
  const auto sort_out = [](std::vector<int>& list) {
    std::sort(list.begin(), list.end());
    list.erase(std::unique(list.begin(), list.end()), list.end());
  };
  sort_out(turning);
  sort_out(others);
  bodies_ = turning;
  turning_ = turning.size();
  std::set_difference(others.begin(), others.end(), turning.begin(), turning.end(),
                      std::back_inserter(bodies_));
}

void EquationsOfMotion::add_links(const std::vector<Joint>& all_joints, const Ends& ends,
                                  const std::vector<MassProperties>& masses,
                                  const std::vector<CoupledTerms>& couplings) {
  std::unordered_map<std::size_t, std::size_t> place_of;  // of movable bodies
  for (std::size_t i = 0; i < bodies_.size(); ++i) place_of[at(bodies_[i])] = i;
  const auto turns_an_end = [&](int j) {
    const auto turns_body = [&](std::size_t body) {
      return masses[body].is_movable() && turns(place_of.at(body));
    };
    return turns_body(ends[at(j)].first) || turns_body(ends[at(j)].second);
  };
  // rods between centres, other rods, ball joints, general ones, springs
  const auto kind = [&](int j) {
    const auto* distance = if_distance(all_joints[at(j)]);
    if (distance == nullptr) return info(all_joints[at(j)].kind).form == RowsForm::kGeneral ? 3 : 2;
    if (distance->is_soft()) return 4;
    return turns_an_end(j) ? 1 : 0;
  };
  std::stable_sort(joints_.begin(), joints_.end(), [&](int i, int j) { return kind(i) < kind(j); });
  const auto count_below = [&](int most) {
    return static_cast<std::size_t>(
        std::count_if(joints_.begin(), joints_.end(), [&](int j) { return kind(j) < most; }));
  };
  first_armed_ = count_below(1);
  first_ball_ = count_below(2);
  first_general_ = count_below(3);
  first_spring_ = count_below(4);

  const auto point_of = [&](std::size_t body, const Vector3d& anchor, bool has_axes) {
    if (masses[body].is_movable()) return place_of.at(body);
    fixed_points_.push_back({static_cast<int>(body), anchor, has_axes, BodyState{},
                             Vector3d::Zero(), Vector3d::Zero()});
    inverse_mass_.push_back(0.0);
    return inverse_mass_.size() - 1;
  };
  for (const int j : joints_) {
    const Joint& joint = all_joints[at(j)];
    Link link{};
    const bool has_axes = info(joint.kind).has_frames;
    link.a = point_of(ends[at(j)].first, joint.anchor_a, has_axes);
    link.b = point_of(ends[at(j)].second, joint.anchor_b, has_axes);
    link.kind = joint.kind;
    link.anchor_a = joint.anchor_a;
    link.anchor_b = joint.anchor_b;
    link.has_arms = turns(link.a) || turns(link.b);
    if (const auto* distance = if_distance(joint)) {
      link.stiffness = distance->stiffness;
      link.damping = distance->damping;
    }
    if (has_axes) {
      link.frame_a = joint.frame_a.toRotationMatrix();
      link.frame_b = joint.frame_b->toRotationMatrix();
      for (const std::size_t body : {ends[at(j)].first, ends[at(j)].second})
        link.radius = std::max(link.radius, masses[body].radius_of_gyration());
    }
    add_coordinates(joint, &link);
    links_.push_back(link);
  }
  if (is_chain_) turn_along_chain();
  for (std::size_t l = 0; l < first_general_; ++l) add_rows(links_[l], is_rod(l) ? 1 : 3);
  for (std::size_t l = first_general_; l < first_spring_; ++l) {
    links_[l].first_row = rows_.size();
    for (std::size_t k = 0; k < rows_of(l); ++k) {
      const ScalarForm of_row = form(l, k);
      general_rows_.push_back(
          {rows_.size() + k, l, of_row, of_row.has_separation() ? 1.0 : links_[l].radius});
    }
    add_rows(links_[l], static_cast<int>(rows_of(l)));
  }
  add_coupled_rows(all_joints, couplings);
  vectors_.resize(first_spring_ - first_general_);
  motions_.resize(first_spring_ - first_general_);
  for (std::size_t l = first_general_; l < first_spring_; ++l)
    frames_.emplace_back(links_[l].anchor_b, links_[l].frame_b);
  fixed_axes_.assign(fixed_points_.size(), Matrix3d::Identity());
}

// what acts along the coordinates of the joint that is compiled to the next link
void EquationsOfMotion::add_coordinates(const Joint& joint, Link* link) {
  const JointKindInfo& kind = info(joint.kind);
  link->rows = kind.rows;
  link->first_soft = softs_.size();
  for (int i = 0; i < kind.coordinates; ++i) {
    const CoordinateLaw& law = joint.coordinates[at(i)];
    const SoftLaw soft = soft_law(law);
    if (is_held(law))
      link->function[at(link->rows++)] = static_cast<std::uint8_t>(kind.rows + i);
    else if (!soft.is_none())
      softs_.push_back({links_.size(), kind.rows + i, kind.coordinate[at(i)], soft, law.zero});
  }
  link->softs = softs_.size() - link->first_soft;
}

EquationsOfMotion::Row EquationsOfMotion::new_row(const Link& link, std::size_t part) {
  Row row{};
  row.a = link.a;
  row.b = link.b;
  row.turn_a = row.turn_b = -1;
  row.inverse_mass = inverse_mass_[link.a] + inverse_mass_[link.b];
  const auto turn = [&](std::size_t point) {
    turns_.push_back({point, part, 0});
    return static_cast<int>(turns_.size()) - 1;
  };
  if (turns(link.a)) row.turn_a = turn(link.a);
  if (turns(link.b)) row.turn_b = turn(link.b);
  return row;
}

void EquationsOfMotion::add_rows(const Link& link, int count) {
  for (int k = 0; k < count; ++k) {
    rows_.push_back(new_row(link, rows_.size()));
    const bool is_of_ball = info(link.kind).form == RowsForm::kPoint;
    direction_.emplace_back(is_of_ball ? Vector3d(Vector3d::Unit(k)) : Vector3d(Vector3d::Zero()));
  }
}

// Coupled rows with their first parts, then all second ones.
void EquationsOfMotion::add_coupled_rows(const std::vector<Joint>& all_joints,
                                         const std::vector<CoupledTerms>& couplings) {
  const auto link_of = [&](std::size_t joint) {
    const auto found = std::find(joints_.begin(), joints_.end(), static_cast<int>(joint));
    return static_cast<std::size_t>(found - joints_.begin());
  };
  for (std::size_t l = first_general_; l < first_spring_; ++l) {
    if (!couples(links_[l].kind)) continue;
    CoupledRow coupled{};
    coupled.link = l;
    for (std::size_t k = 0; k < 2; ++k) {
      const CoupledTerm& from = couplings[at(joints_[l])][k];
      const Joint& joint = all_joints[from.joint];
      const auto i = at(from.coordinate);
      CoupledRow::Term& term = coupled.terms[k];
      term.link = link_of(from.joint);
      term.coordinate = from.coordinate;
      term.form = info(joint.kind).coordinate[i];
      term.ratio = from.ratio;
      term.zero = joint.coordinates[i].zero;
    }
    const CoupledRow::Term& first = coupled.terms[0];
    coupled.metres = first.form.is_angle ? links_[first.link].radius : 1.0;
    coupled_.push_back(coupled);
  }
  for (CoupledRow& coupled : coupled_) {
    coupled.row = coupled.terms[0].part = rows_.size();
    rows_.push_back(new_row(links_[coupled.terms[0].link], rows_.size()));
    direction_.emplace_back(Vector3d::Zero());
  }
  for (CoupledRow& coupled : coupled_) {
    coupled.terms[1].part = parts();
    parts_.push_back(new_row(links_[coupled.terms[1].link], parts()));
    direction_.emplace_back(Vector3d::Zero());
  }
}

// Entries of A, and what they come from. Redundant rows have none; their unknowns are the last.
void EquationsOfMotion::couple_rows() {
  struct End {
    std::size_t row;
    double sign;
    int turn;
  };
  std::vector<std::vector<End>> ends_on(bodies_.size());
  for (std::size_t i = 0; i < parts(); ++i) {
    const Row& row = part(i);
    if (row.a < bodies_.size()) ends_on[row.a].push_back({i, -1.0, row.turn_a});
    if (row.b < bodies_.size()) ends_on[row.b].push_back({i, 1.0, row.turn_b});
  }
  std::vector<int> number(rows_.size(), -1);  // of rows among those kept
  kept_ = 0;
  for (std::size_t i = 0; i < rows_.size(); ++i)
    if (!is_redundant_[i]) number[i] = static_cast<int>(kept_++);
  const auto is_kept = [&](const End& end) { return !is_redundant_[row_of_part(end.row)]; };
  const auto number_of = [&](const End& end) { return number[row_of_part(end.row)]; };

  std::vector<std::pair<int, int>> pattern;
  std::vector<std::vector<End>> kept_on(bodies_.size());
  for (std::size_t body = 0; body < bodies_.size(); ++body) {
    auto& ends = kept_on[body];
    std::copy_if(ends_on[body].begin(), ends_on[body].end(), std::back_inserter(ends), is_kept);
    for (std::size_t m = 0; m < ends.size(); ++m)
      for (std::size_t n = 0; n < m; ++n)
        pattern.emplace_back(number_of(ends[m]), number_of(ends[n]));
  }
  ldlt_.analyze(static_cast<int>(kept_), pattern);

  const auto slot = [&](std::size_t i, std::size_t j) { return ldlt_.slot(number[i], number[j]); };
  std::size_t last = kept_;
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    rows_[i].unknown = is_redundant_[i] ? last++ : at(ldlt_.place(number[i]));
    if (!is_redundant_[i]) rows_[i].diagonal = slot(i, i);
  }
  for (Turn& turn : turns_) turn.unknown = rows_[row_of_part(turn.row)].unknown;

  pulls_.clear();
  pulls_end_.clear();
  for (const auto& ends : ends_on) {
    for (const End& end : ends)
      pulls_.push_back({end.row, rows_[row_of_part(end.row)].unknown, end.sign});
    pulls_end_.push_back(pulls_.size());
  }

  const std::size_t first_general = first_general_row(), first_coupled = first_coupled_row();
  const auto are_two_axes = [&](std::size_t i, std::size_t j) {
    const auto is_general = [&](std::size_t row) { return row >= first_general; };
    const auto has_no_force = [&](std::size_t row) {
      return is_general(row) && row < first_coupled &&
             !general_rows_[row - first_general].form.has_separation();
    };
    if (has_no_force(i) || has_no_force(j)) return true;
    if (is_general(i) || is_general(j)) return false;
    return i >= first_ball_ && j >= first_ball_ && direction_[i] != direction_[j];
  };
  linear_couplings_.clear();
  angular_couplings_.clear();
  for (std::size_t body = 0; body < bodies_.size(); ++body) {
    const auto& ends = kept_on[body];
    for (std::size_t m = 0; m < ends.size(); ++m) {
      for (std::size_t n = 0; n < m; ++n) {
        if (are_two_axes(ends[m].row, ends[n].row)) continue;
        const double twice = number_of(ends[m]) == number_of(ends[n]) ? 2.0 : 1.0;
        linear_couplings_.push_back({ends[m].row, ends[n].row,
                                     twice * ends[m].sign * ends[n].sign * inverse_mass_[body],
                                     ldlt_.slot(number_of(ends[m]), number_of(ends[n]))});
      }
      if (!turns(body)) continue;
      for (std::size_t n = 0; n <= m; ++n) {
        const AngularCoupling coupling{at(ends[m].turn), at(ends[n].turn),
                                       ldlt_.slot(number_of(ends[m]), number_of(ends[n]))};
        angular_couplings_.push_back(coupling);
        if (n < m && number_of(ends[m]) == number_of(ends[n]))  // both parts of one row
          angular_couplings_.push_back({coupling.q, coupling.p, coupling.slot});
      }
    }
  }
}

// the rows of general joints: vectors, and with these their Jacobians
void EquationsOfMotion::place_general() {
  for (std::size_t l = first_general_; l < first_spring_; ++l) {
    const Link& link = links_[l];
    JointVectors& vectors = vectors_[l - first_general_];
    vectors.r_A = arm_a_[l];
    vectors.r_B = arm_b_[l];
    vectors.d = d_[l];
    const auto axes = [&](std::size_t point, const Matrix3d& frame) -> Matrix3d {
      if (turns(point)) return orientation_[point] * frame;
      return point < bodies_.size() ? frame : Matrix3d(fixed_axes(point) * frame);
    };
    if (!info(link.kind).has_frames) continue;
    vectors.axes_A = axes(link.a, link.frame_a);
    vectors.axes_B = axes(link.b, frame_b(l).axes);
  }
  place_general_rows();
  if (!coupled_.empty()) place_coupled();
}

// by the vectors of their joints
void EquationsOfMotion::place_general_rows() {
  for (const GeneralRow& general : general_rows_) {
    const Row& row = rows_[general.row];
    const JointVectors& vectors = vectors_[general.link - first_general_];
    const Jacobian J = jacobian(general.form, vectors);
    direction_[general.row] = J.j3;
    if (row.turn_a >= 0) turn_[at(row.turn_a)] = J.j2;
    if (row.turn_b >= 0) turn_[at(row.turn_b)] = J.j4;
    for (const int turn : {row.turn_a, row.turn_b})
      if (turn >= 0)
        turn_response_[at(turn)].noalias() =
            inverse_inertia_[turns_[at(turn)].body] * turn_[at(turn)];
  }
}

void EquationsOfMotion::place_coupled() {
  for (const CoupledRow& coupled : coupled_) {
    for (const CoupledRow::Term& term : coupled.terms) {
      const Row& row = part(term.part);
      const Jacobian J = jacobian(term.form, vectors_[term.link - first_general_]);
      direction_[term.part] = term.ratio * J.j3;
      if (row.turn_a >= 0) turn_[at(row.turn_a)] = term.ratio * J.j2;
      if (row.turn_b >= 0) turn_[at(row.turn_b)] = term.ratio * J.j4;
      for (const int turn : {row.turn_a, row.turn_b})
        if (turn >= 0)
          turn_response_[at(turn)].noalias() =
              inverse_inertia_[turns_[at(turn)].body] * turn_[at(turn)];
    }
  }
}

// ---- couplings

void EquationsOfMotion::ask_coupled(std::size_t l, const JointCourse& course, double t) {
  for (CoupledRow& coupled : coupled_) {
    if (coupled.link != l) continue;
    coupled.closing = course.coupling(t);
    rate_target_[coupled.row] = coupled.closing.rate;
    acceleration_target_[coupled.row] = coupled.closing.acceleration;
  }
}

double EquationsOfMotion::reading_of(const CoupledRow::Term& term) const {
  const double there = value(term.form, vectors_[term.link - first_general_]);
  return reading(term.form, there, term.zero, term.position + (placed_at_ - noted_at_) * term.rate);
}

double EquationsOfMotion::value_of(const CoupledRow& coupled) const {
  double sum = 0.0;
  for (const CoupledRow::Term& term : coupled.terms) sum += term.ratio * reading_of(term);
  return sum - coupled.constant - coupled.closing.value;
}

void EquationsOfMotion::add_coupled_right_hand_side(const Vector3d* free, double* b) const {
  for (const CoupledRow& coupled : coupled_) {
    double& sum = b[rows_[coupled.row].unknown] = 0.0;
    for (const CoupledRow::Term& term : coupled.terms) {
      const Row& of = part(term.part);
      const std::size_t g = term.link - first_general_;
      sum -= term.ratio * gamma(term.form, vectors_[g], motions_[g]) +
             direction_[term.part].dot(free[of.b] - free[of.a]);
    }
  }
}

double EquationsOfMotion::coupled_impulse(std::size_t l) const {
  for (const CoupledRow& coupled : coupled_)
    if (coupled.link == l) return impulses_[rows_[coupled.row].unknown];
  return 0.0;
}

// no force of rows that are redundant
void EquationsOfMotion::clear_redundant(double* lambda) const {
  std::fill(lambda + kept_, lambda + rows_.size(), 0.0);
}

void EquationsOfMotion::move_general() {
  for (std::size_t l = first_general_; l < first_spring_; ++l)
    motions_[l - first_general_] = motion_of(l);
}

// how the vectors of a general joint move
JointMotion EquationsOfMotion::motion_of(std::size_t l) const {
  const Link& link = links_[l];
  const auto spin = [&](std::size_t point) -> Vector3d {
    if (turns(point)) return spin_[point];
    if (point < bodies_.size()) return Vector3d::Zero();
    return fixed_points_[point - bodies_.size()].start.angular_velocity;
  };
  JointMotion motion;
  motion.d_dot = d_dot(l);
  motion.d_bias = gamma_d(l);
  motion.w_A = spin(link.a);
  motion.w_B = spin(link.b);
  if (frame_b(l).moves) {
    MovingFrame frame = frame_b(l);
    if (!turns(link.b))  // in the velocity of the fixed point
      frame.anchor_rate = frame.anchor_acceleration = Vector3d::Zero();
    motion.add(frame, turns(link.b) ? orientation_[link.b] : fixed_axes(link.b));
  }
  return motion;
}

}  // namespace constraint_sim::engine
