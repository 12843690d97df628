#include "engine/methods/least_squares/row_targets.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "engine/math/larger.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Returns the target of the vector d from anchor A to anchor B at the pose of B, in world axes [m].
// Zero unless the joint is a ball joint that closes its error by moving its frame on B.
Vector3d ball_offset(const EquationsOfMotion& equations, std::size_t joint,
                     const Configuration& configuration) {
  if (!equations.is_general(joint) || !equations.inputs().frame_b(joint).moves)
    return Vector3d::Zero();
  const EquationsOfMotion::Link& link = equations.links()[joint];
  const Vector3d shift = equations.inputs().frame_b(joint).anchor - link.anchor_b;
  return link.b < equations.rotating() ? -(configuration.orientation[link.b] * shift)
                                       : Vector3d(-shift);
}

// Frames on B of all joints where frames move, else none.
void place_frames(const EquationsOfMotion& equations, List<MovingFrame>* frames) {
  frames->clear();
  const std::size_t joints = equations.links().size();
  const auto moves = [&](std::size_t l) {
    return equations.is_general(l) && equations.inputs().frame_b(l).moves;
  };
  bool any = false;
  for (std::size_t l = 0; l < joints && !any; ++l) any = moves(l);
  for (std::size_t l = 0; l < joints && any; ++l)
    frames->push_back(equations.is_general(l)
                          ? equations.inputs().frame_b(l)
                          : MovingFrame(equations.links()[l].anchor_b, Matrix3d::Identity()));
}

}  // namespace

double largest_of(const List<double>& list) {
  double most = 0.0;
  for (const double x : list) most = larger(most, std::abs(x));
  return most;
}

RowTargets::RowTargets(const RegularizedRows& rows, BodyVectors zeros)
    : length_(rows.rows().size(), 0.0), rate_(rows.rows().size(), 0.0), fixed_(std::move(zeros)) {}

// ---- targets

void RowTargets::set(double t, const RegularizedRows& rows, EquationsOfMotion* equations,
                     Configuration* configuration) {
  equations->move_with_time(t);
  softs_ = equations->soft_coordinates();
  coupled_ = equations->coupled_rows();
  read_positions(equations->coordinates());
  is_driven_ = equations->inputs().is_time_dependent();
  const std::size_t bodies = equations->bodies().size();
  for (std::size_t p = bodies; p < configuration->position.size(); ++p) {
    configuration->position[p] = equations->kinematics().position()[p];
    fixed_.linear[p] =
        equations->inputs().body_velocity(p, t, equations->kinematics().position()[p]);
    configuration->fixed_axes[p - bodies] = equations->inputs().fixed_axes(p);
  }
  place_frames(*equations, &configuration->frames_b);
  for (std::size_t l = 0; l < equations->links().size(); ++l)
    set_joint(t, l, rows, equations, *configuration);
  for (std::size_t i = rows.rows().size() - coupled_.size(); i < rows.rows().size(); ++i) {
    const RegularizedRows::Row& row = rows.rows()[i];
    const auto c = to_index(row.coupled);
    length_[i] = row.metres * (equations->coordinates().constant(c) +
                               equations->inputs().coupling_offset(c).value);
    rate_[i] = 0.0;
  }
  scale_ = largest_of(length_);
  for (const Vector3d& x : configuration->position)
    scale_ = std::max(scale_, x.cwiseAbs().maxCoeff());
  if (scale_ == 0.0) scale_ = 1.0;
}

void RowTargets::set_joint(double t, std::size_t l, const RegularizedRows& rows,
                           EquationsOfMotion* equations, const Configuration& configuration) {
  const std::size_t i = rows.first_row(l);
  if (!equations->is_ball(l) && !equations->is_general(l)) {
    length_[i] = equations->inputs().length()[l].value;
    rate_[i] = equations->is_rod(l) ? equations->inputs().driven_rate(*equations, l, t)[0]
                                    : equations->inputs().length()[l].rate;
    return;
  }
  const EquationsOfMotion::Link& link = equations->links()[l];
  RowVector offset = equations->inputs().offset(*equations, l);
  if (forms(link.kind).form == RowsForm::kPoint)
    offset.head<3>() += ball_offset(*equations, l, configuration);
  const RowVector rate = equations->inputs().driven_rate(*equations, l, t);
  for (std::size_t k = 0; k < equations->rows_of(l); ++k) {
    const double metres = rows.rows()[i + k].metres;
    length_[i + k] = metres * offset[static_cast<Eigen::Index>(k)];
    rate_[i + k] = metres * rate[static_cast<Eigen::Index>(k)];
  }
  for (std::size_t s = 0; s < link.softs; ++s) {
    const std::size_t k = i + equations->rows_of(l) + s;
    length_[k] = rows.rows()[k].metres * softs_[link.first_soft + s].law.R;
  }
}

// ---- errors

// Components of the offset of a ball joint.
Vector3d RowTargets::components(std::size_t first_row) const {
  return Eigen::Map<const Vector3d>(length_.data() + first_row);
}

// Share of d of a ball joint between two bodies that is off its target. The length of d has to
// follow the length of the offset, but d may rotate with the bodies.
double RowTargets::share_off(std::size_t first_row, const Vector3d& d) const {
  const double distance = d.norm(), offset = components(first_row).norm();
  return distance > offset ? 1.0 - offset / distance : 0.0;
}

// Position of the coordinate of term k of coupled row c.
double RowTargets::reading(std::size_t c, std::size_t k,
                           const RegularizedRows::Geometry& geometry) const {
  const EquationsOfMotion::CoupledRow::Term& term = coupled_[c].terms[k];
  return engine::reading(term.form, value(term.form, geometry[term.link].vectors()), term.zero,
                         term_positions_[c][k]);
}

// Error of a row of a general joint [m]; whole turns of an angle do not count.
double RowTargets::general_error(const RegularizedRows& rows, std::size_t i,
                                 const RegularizedRows::Geometry& geometry) const {
  const RegularizedRows::Row& row = rows.rows()[i];
  if (row.coupled >= 0) {
    double sum = 0.0;
    const auto c = to_index(row.coupled);
    for (std::size_t k = 0; k < 2; ++k) sum += coupled_[c].terms[k].ratio * reading(c, k, geometry);
    return row.metres * sum - length_[i];
  }
  const double there = value(row.form, geometry[row.joint].vectors());
  if (!row.form.is_angle) return row.metres * there - length_[i];
  return row.metres * unwound(there - length_[i] / row.metres, 0.0);
}

double RowTargets::errors(const RegularizedRows& rows, const RegularizedRows::Geometry& geometry,
                          const List<double>& weights, List<double>* values) const {
  double sum = 0.0;
  for (std::size_t i = 0; i < values->size(); ++i) {
    const RegularizedRows::Row& row = rows.rows()[i];
    const Vector3d& d = geometry[row.joint].d;
    double& error = (*values)[i];
    if (row.is_spring)
      error = 0.0;
    else if (row.is_general)
      error = general_error(rows, i, geometry);
    else if (row.axis < 0)
      error = d.norm() - length_[i];
    else if (rows.is_between_bodies(row.joint))
      error = d[row.axis] * share_off(rows.first_row(row.joint), d);
    else
      error = d[row.axis] - length_[i];
    sum += error * error / weights[i];
  }
  return sum;
}

double RowTargets::extent(const RegularizedRows& rows, std::size_t i,
                          const RegularizedRows::Geometry& geometry) const {
  const RegularizedRows::Row& row = rows.rows()[i];
  if (row.soft < 0) return geometry[row.joint].d.norm();
  const EquationsOfMotion::SoftCoordinate& soft = softs_[row.soft];
  const double there = value(soft.form, geometry[row.joint].vectors());
  return row.metres * engine::reading(soft.form, there, soft.zero, soft_positions_[row.soft]);
}

void RowTargets::write_positions(const RegularizedRows& rows,
                                 const RegularizedRows::Geometry& geometry,
                                 EquationsOfMotion* equations) {
  for (std::size_t i = 0; i < rows.rows().size(); ++i) {
    const RegularizedRows::Row& row = rows.rows()[i];
    if (row.soft >= 0)
      equations->coordinates().set_soft(to_index(row.soft), extent(rows, i, geometry) / row.metres);
  }
  for (std::size_t c = 0; c < coupled_.size(); ++c)
    for (std::size_t k = 0; k < 2; ++k)
      equations->coordinates().set_term(c, k, reading(c, k, geometry));
  read_positions(equations->coordinates());
}

void RowTargets::read_positions(const CoordinatePositions& coordinates) {
  soft_positions_.resize(softs_.size());
  term_positions_.resize(coupled_.size());
  for (std::size_t s = 0; s < softs_.size(); ++s) soft_positions_[s] = coordinates.soft(s);
  for (std::size_t c = 0; c < coupled_.size(); ++c)
    for (std::size_t k = 0; k < 2; ++k) term_positions_[c][k] = coordinates.term(c, k);
}

}  // namespace constraint_sim::engine
