#include "engine/dynamics/regularized_rows.h"

#include <utility>

#include "engine/math/list.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

std::size_t end_of(const EquationsOfMotion::Link& joint, std::size_t end) {
  return end == 0 ? joint.a : joint.b;
}

}  // namespace

RegularizedRows::RegularizedRows(const EquationsOfMotion& equations)
    : joints_(equations.links()),
      bodies_(equations.bodies().size()),
      rotating_(equations.rotating()) {
  for (std::size_t p = 0; p < equations.points(); ++p)
    inverse_mass_.push_back(equations.inverse_mass(p));
  for (std::size_t i = 0; i < rotating_; ++i) inertia_.push_back(equations.inertia(i));
  for (std::size_t l = 0; l < joints_.size(); ++l) {
    first_row_.push_back(rows_.size());
    const bool is_ball = forms(joints_[l].kind).form == RowsForm::kPoint;
    const int rigid_rows = static_cast<int>(equations.rows_of(l));
    for (int k = 0; k < rigid_rows + static_cast<int>(joints_[l].softs); ++k) {
      Row row;
      row.joint = l;
      row.index = k;
      row.axis = is_ball ? k : -1;
      row.is_general = equations.is_general(l) && !is_ball;
      row.is_spring = !is_ball && !row.is_general && !equations.is_rod(l);
      if (row.is_general) {
        row.is_spring = k >= rigid_rows;
        if (row.is_spring) row.soft = static_cast<int>(joints_[l].first_soft) + k - rigid_rows;
        row.form = row.is_spring
                       ? equations.soft_coordinates()[static_cast<std::size_t>(row.soft)].form
                       : equations.form(l, static_cast<std::size_t>(k));
        if (!row.form.has_separation()) row.metres = joints_[l].radius;
      }
      row.angular.fill(Vector3d::Zero());
      row.response = row.angular;
      if (is_ball) row.direction = Vector3d::Unit(k);
      rows_.push_back(row);
    }
  }
  add_coupled(equations);
  List<List<std::pair<std::size_t, std::size_t>>> ends_on(bodies_);  // pairs of part and end
  for (std::size_t i = 0; i < rows_.size() + parts_.size(); ++i) {
    for (std::size_t e = 0; e < 2; ++e) {
      const std::size_t point = end_of(joints_[part(i).joint], e);
      if (point < bodies_) ends_on[point].emplace_back(i, e);
    }
  }
  List<std::pair<int, int>> pattern;
  for (std::size_t body = 0; body < bodies_; ++body) {
    const auto& ends = ends_on[body];
    for (std::size_t m = 0; m < ends.size(); ++m)
      for (std::size_t n = 0; n <= m; ++n) {
        couplings_.push_back(
            {ends[m].first, ends[n].first, ends[m].second, ends[n].second, body, 0});
        pattern.emplace_back(static_cast<int>(row_of_part(ends[m].first)),
                             static_cast<int>(row_of_part(ends[n].first)));
      }
  }
  ldlt_.analyze(static_cast<int>(rows_.size()), pattern);
  const auto slot = [&](std::size_t i, std::size_t j) {
    return ldlt_.slot(static_cast<int>(i), static_cast<int>(j));
  };
  for (Coupling& c : couplings_) c.slot = slot(row_of_part(c.i), row_of_part(c.j));
  for (std::size_t i = 0; i < rows_.size(); ++i) rows_[i].diagonal = slot(i, i);
  permuted_.assign(rows_.size(), 0.0);
}

void RegularizedRows::add_coupled(const EquationsOfMotion& equations) {
  for (std::size_t c = 0; c < equations.coupled_rows().size(); ++c) {
    const EquationsOfMotion::CoupledRow& from = equations.coupled_rows()[c];
    for (std::size_t k = 0; k < 2; ++k) {
      Row row;
      row.joint = from.terms[k].link;
      row.is_general = true;
      row.form = from.terms[k].form;
      row.metres = from.metres * from.terms[k].ratio;
      row.coupled = static_cast<int>(c);
      row.angular.fill(Vector3d::Zero());
      row.response = row.angular;
      (k == 0 ? rows_ : parts_).push_back(row);
    }
  }
}

void RegularizedRows::measure(const Configuration& configuration, Geometry* geometry) const {
  geometry->resize(joints_.size());
  for (std::size_t l = 0; l < joints_.size(); ++l) {
    JointGeometry& g = (*geometry)[l];
    const EquationsOfMotion::Link& joint = joints_[l];
    const bool is_ball = forms(joint.kind).form == RowsForm::kPoint;
    g.custom = joint.custom;
    g.d = configuration.position[joint.b] - configuration.position[joint.a];
    for (std::size_t e = 0; e < 2; ++e) {
      const std::size_t point = end_of(joint, e);
      g.arm[e].setZero();
      if (point >= rotating_) continue;
      const bool moves = e == 1 && !is_ball && !configuration.frames_b.empty();
      const Vector3d& anchor_b = moves ? configuration.frames_b[l].anchor : joint.anchor_b;
      g.arm[e] = configuration.orientation[point] * (e == 0 ? joint.anchor_a : anchor_b);
      g.d += kEndSign[e] * g.arm[e];
    }
    if (info(joint.kind).has_frames) {
      for (std::size_t e = 0; e < 2; ++e) {
        const std::size_t point = end_of(joint, e);
        g.axes[e] = e == 0 ? joint.frame_a : joint.frame_b;
        if (e == 1 && !configuration.frames_b.empty()) g.axes[e] = configuration.frames_b[l].axes;
        if (point < rotating_)
          g.axes[e] = configuration.orientation[point].toRotationMatrix() * g.axes[e];
        if (point >= bodies_) g.axes[e] = configuration.fixed_axes[point - bodies_] * g.axes[e];
      }
    }
    if (!is_ball || !is_between_bodies(l)) continue;
    g.arm[0] += 0.5 * g.d;
    g.arm[1] -= 0.5 * g.d;
  }
}

void RegularizedRows::linearize(const Geometry& a, const Geometry& b,
                                const Configuration& inertia) {
  List<Matrix3d> inverse_inertia(rotating_);
  for (std::size_t i = 0; i < rotating_; ++i) {
    const Matrix3d R = inertia.orientation[i].toRotationMatrix();
    inverse_inertia[i] = R * inertia_[i].cwiseInverse().asDiagonal() * R.transpose();
  }
  for (Row& row : parts_)
    linearize(a[row.joint].vectors(), b[row.joint].vectors(), inverse_inertia, &row);
  for (Row& row : rows_) {
    const JointGeometry& g = a[row.joint];
    const JointGeometry& h = b[row.joint];
    if (row.is_general) {
      linearize(g.vectors(), h.vectors(), inverse_inertia, &row);
      continue;
    }
    if (row.axis < 0) {
      const double length = g.d.norm() + h.d.norm();
      row.direction = length > 0.0 ? Vector3d((g.d + h.d) / length) : Vector3d(Vector3d::UnitX());
    }
    for (std::size_t e = 0; e < 2; ++e) {
      const std::size_t point = end_of(joints_[row.joint], e);
      if (point >= rotating_) continue;
      row.angular[e] = (0.5 * kEndSign[e] * (g.arm[e] + h.arm[e])).cross(row.direction);
      row.response[e] = inverse_inertia[point] * row.angular[e];
    }
  }
}

// Linearizes a row of a general joint. Arms of rows along world axes meet halfway, so that such
// rows have no moment where they are off.
void RegularizedRows::linearize(const JointVectors& a, const JointVectors& b,
                                const List<Matrix3d>& inverse_inertia, Row* row) const {
  JointVectors start = a, end = b;
  const bool is_along_world =
      !row->form.is_angle && row->form.product.v.kind == VectorKind::kWorldAxis;
  for (JointVectors* vectors : {&start, &end}) {
    if (!is_along_world || !is_between_bodies(row->joint)) break;
    vectors->r_A += 0.5 * vectors->d;
    vectors->r_B -= 0.5 * vectors->d;
  }
  const Jacobian J = discrete_gradient(row->form, start, end);
  row->direction = row->metres * J.j3;
  row->angular = {row->metres * J.j2, row->metres * J.j4};
  for (std::size_t e = 0; e < 2; ++e) {
    const std::size_t point = end_of(joints_[row->joint], e);
    if (point < rotating_) row->response[e] = inverse_inertia[point] * row->angular[e];
  }
}

double RegularizedRows::product(const Coupling& c) const {
  const Row& i = part(c.i);
  const Row& j = part(c.j);
  const double sign = kEndSign[c.end_i] * kEndSign[c.end_j];
  double sum = sign * inverse_mass_[c.body] * i.direction.dot(j.direction);
  if (c.body < rotating_) sum += i.angular[c.end_i].dot(j.response[c.end_j]);
  const bool is_across = c.i != c.j && row_of_part(c.i) == row_of_part(c.j);
  return is_across ? 2.0 * sum : sum;
}

void RegularizedRows::find_weights(List<double>* weights) const {
  weights->assign(rows_.size(), 0.0);
  for (const Coupling& c : couplings_)
    if (row_of_part(c.i) == row_of_part(c.j)) (*weights)[row_of_part(c.i)] += product(c);
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    if (rows_[i].axis != 0) continue;
    double* const w = weights->data() + i;
    w[0] = w[1] = w[2] = (w[0] + w[1] + w[2]) / 3.0;
  }
}

void RegularizedRows::factor(double share, const List<double>& weights,
                             const List<double>* compliance) {
  List<double>& A = ldlt_.values();
  std::fill(A.begin(), A.end(), 0.0);
  for (const Coupling& c : couplings_)
    if (compliance != nullptr || (!part(c.i).is_spring && !part(c.j).is_spring))
      A[c.slot] += product(c);
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    const bool is_off = rows_[i].is_spring && compliance == nullptr;
    double added = share * weights[i];
    if (is_off) added = 1.0;
    if (rows_[i].is_spring && compliance != nullptr) added = (*compliance)[i];
    A[rows_[i].diagonal] += added;
  }
  ldlt_.factor(0.01 * share);
}

void RegularizedRows::solve(List<double>* b) {
  for (std::size_t i = 0; i < rows_.size(); ++i)
    permuted_[static_cast<std::size_t>(ldlt_.place(static_cast<int>(i)))] = (*b)[i];
  ldlt_.solve(permuted_.data());
  for (std::size_t i = 0; i < rows_.size(); ++i)
    (*b)[i] = permuted_[static_cast<std::size_t>(ldlt_.place(static_cast<int>(i)))];
}

double RegularizedRows::apply(const Row& row, const BodyVectors& u) const {
  const auto of_part = [&](const Row& one) {
    double sum = 0.0;
    for (std::size_t e = 0; e < 2; ++e) {
      const std::size_t point = end_of(joints_[one.joint], e);
      sum += kEndSign[e] * one.direction.dot(u.linear[point]);
      if (point < rotating_) sum += one.angular[e].dot(u.angular[point]);
    }
    return sum;
  };
  if (row.coupled < 0) return of_part(row);
  return of_part(row) + of_part(parts_[static_cast<std::size_t>(row.coupled)]);
}

void RegularizedRows::add_response(const List<double>& lambda, BodyVectors* u) const {
  for (std::size_t i = 0; i < rows_.size() + parts_.size(); ++i) {
    const Row& row = part(i);
    const double force = lambda[row_of_part(i)];
    for (std::size_t e = 0; e < 2; ++e) {
      const std::size_t point = end_of(joints_[row.joint], e);
      u->linear[point] += kEndSign[e] * inverse_mass_[point] * force * row.direction;
      if (point < rotating_) u->angular[point] += force * row.response[e];
    }
  }
}

void RegularizedRows::apply_transpose(const List<double>& lambda, BodyVectors* u) const {
  for (auto* list : {&u->linear, &u->angular})
    std::fill(list->begin(), list->end(), Vector3d::Zero());
  for (std::size_t i = 0; i < rows_.size() + parts_.size(); ++i) {
    const Row& row = part(i);
    const double force = lambda[row_of_part(i)];
    for (std::size_t e = 0; e < 2; ++e) {
      const std::size_t point = end_of(joints_[row.joint], e);
      u->linear[point] += kEndSign[e] * force * row.direction;
      if (point < rotating_) u->angular[point] += force * row.angular[e];
    }
  }
}

}  // namespace constraint_sim::engine
