// Joints with the rows of their kind in ImplicitStep.

#include <cmath>

#include "engine/dynamics/implicit_step.h"
#include "engine/math/cross_matrix.h"
#include "engine/math/larger.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using ConstVector = Eigen::Map<const Vector3d>;
using Vector = Eigen::Map<Vector3d>;

}  // namespace

ImplicitStep::VectorSlopes::Slope ImplicitStep::VectorSlopes::of(VectorRef u,
                                                                 std::size_t end) const {
  if (u.kind == VectorKind::kSeparation) return d;
  if (u.kind == (end == 0 ? VectorKind::kAxisA : VectorKind::kAxisB)) return axes[u.axis];
  return Slope::Zero();
}

void ImplicitStep::JacobianSlopes::add(VectorRef u, VectorRef other, const JointVectors& v,
                                       const VectorSlopes& slopes, std::size_t end) {
  const Vector3d f = v[other];
  const Slope df = slopes.of(other, end);
  switch (u.kind) {
    case VectorKind::kSeparation:
      force += df;
      torque_A -= cross_matrix(v.r_A) * df;
      torque_B += cross_matrix(v.r_B) * df;
      (end == 0 ? torque_A : torque_B) += (end == 0 ? 1.0 : -1.0) * cross_matrix(f) * slopes.arm;
      break;
    case VectorKind::kAxisA:
      torque_A += cross_matrix(v[u]) * df - cross_matrix(f) * slopes.of(u, end);
      break;
    case VectorKind::kAxisB:
      torque_B += cross_matrix(v[u]) * df - cross_matrix(f) * slopes.of(u, end);
      break;
    case VectorKind::kWorldAxis:
    case VectorKind::kCustom:
      break;
  }
}

// Axes of both ends, with bodies at the start of the step and fixed points at the current time.
void ImplicitStep::place_axes(const EquationsOfMotion& equations, const Link& link,
                              std::array<Matrix3d, 2>* axes) const {
  if (!info(link.joint).has_frames) return;
  for (std::size_t e = 0; e < 2; ++e) {
    const End& end = link.ends[e];
    const std::size_t l = to_index(static_cast<int>(&link - links_.data()));
    const Matrix3d& frame = e == 0 ? link.frames[0] : equations.inputs().frame_b(l).axes;
    (*axes)[e] = frame;
    if (end.dofs == 6) (*axes)[e] = J_angular_[end.point].R0 * frame;
    if (end.dofs == 0) (*axes)[e] = equations.inputs().fixed_axes(end.point) * frame;
  }
}

JointVectors ImplicitStep::start_of(const Shape& shape) {
  JointVectors vectors;
  vectors.custom = shape.custom;
  vectors.r_A = shape.r0[0];
  vectors.r_B = shape.r0[1];
  vectors.d = shape.d0;
  vectors.axes_A = shape.axes0[0];
  vectors.axes_B = shape.axes0[1];
  return vectors;
}

// Computes the scale of each row, 1/√(J M⁻¹ Jᵀ), with the mean principal inertia.
void ImplicitStep::begin_general(const Link& link, Shape* shape) const {
  const JointVectors vectors = start_of(*shape);
  for (int k = 0; k < link.rows; ++k) {
    const Jacobian J = jacobian(info(link.joint).function[link.function[k]], vectors);
    double sum = 0.0;
    for (std::size_t e = 0; e < 2; ++e) {
      const End& end = link.ends[e];
      if (end.dofs == 0) continue;
      sum += J.j3.squaredNorm() / mass_[end.point];
      if (end.dofs == 6) sum += (e == 0 ? J.j2 : J.j4).squaredNorm() / inertia_[end.point].mean();
    }
    shape->row_scale[k] = sum > 0.0 ? 1.0 / std::sqrt(sum) : 1.0;
  }
}

// Computes the vectors of a joint at the end of the step and where forces are taken, and the
// derivatives of its vectors at the end by the motion of the bodies.
void ImplicitStep::move_general(const Link& link, const Shape& shape, const Unknowns& unknowns,
                                GeneralMotion* motion) const {
  const bool has_frames = info(link.joint).has_frames;
  JointVectors& end_vectors = motion->at_end;
  end_vectors.custom = link.custom;
  Vector3d change = Vector3d::Zero();  // change of d
  for (std::size_t e = 0; e < 2; ++e) {
    const End& end = link.ends[e];
    VectorSlopes& slopes = motion->slopes[e];
    Vector3d& arm = e == 0 ? end_vectors.r_A : end_vectors.r_B;
    Matrix3d& axes = e == 0 ? end_vectors.axes_A : end_vectors.axes_B;
    arm = shape.r0[e];
    if (has_frames) axes = shape.axes1[e];
    if (end.dofs == 0) {
      change += end.sign * shift_[end.point];
      continue;
    }
    change += end.sign * ConstVector(unknowns.data() + end.unknown);
    slopes.d.leftCols<3>() = end.sign * Matrix3d::Identity();
    if (end.dofs < 6) continue;
    const Turning& turn = J_angular_[end.point];
    const ConstVector w(unknowns.data() + end.unknown + 3);
    const auto advance = [&](const Vector3d& start, VectorSlopes::Slope* slope) -> Vector3d {
      const Vector3d mean = turn.B * start;
      slope->rightCols<3>() = -turn.B * cross_matrix(mean);
      return start + w.cross(mean);
    };
    arm = advance(e == 0 ? shape.r0[0] : shape.next_r_B, &slopes.arm);
    change += end.sign * (arm - shape.r0[e]);
    slopes.d.rightCols<3>() = end.sign * slopes.arm.rightCols<3>();
    for (int k = 0; has_frames && k < 3; ++k)
      axes.col(k) = advance((e == 0 ? shape.axes0[0] : shape.next_axes_B).col(k), &slopes.axes[k]);
  }
  end_vectors.d = shape.d0 + change;
  motion->at_force = between(start_of(shape), end_vectors, share_);
}

// Computes the laws of soft rows, divided by their factor of q₁ and the scale by inertia:
//   midpoint: λ = −K (½(q₀ + q₁) − R) − (C/h)(q₁ − q₀) + F
//   BDF2:     λ = −K (q₁ − R) − (C/2h)(3 q₁ − 4 q₀ + q₋) + F
void ImplicitStep::begin_softs(const Link& link, const Shape& shape,
                               const EquationsOfMotion& equations) {
  const JointVectors vectors = start_of(shape);
  for (int k = link.rigid_rows; k < link.rows; ++k) {
    const std::size_t s = link.first_soft + to_index(k - link.rigid_rows);
    const EquationsOfMotion::SoftCoordinate& from = equations.soft_coordinates()[s];
    const SoftLaw& law = from.law;
    SoftRow& soft = softs_[s];
    const double before = soft.start;
    soft.start = soft.end =
        reading(from.form, value(from.form, vectors), from.zero, equations.coordinates().soft(s));
    const double rate = law.C / h_;
    double of_q1 = 0.5 * law.K + rate, rest = (rate - 0.5 * law.K) * soft.start;
    if (rule_ == ImplicitRule::kBdf2) {
      of_q1 = law.K + 1.5 * rate;
      rest = rate * (2.0 * soft.start - 0.5 * before);
    }
    const double scale = of_q1 + shape.row_scale[k] * shape.row_scale[k] / s_;
    soft.given = 1.0 / scale;
    soft.taken = of_q1 / scale;
    soft.target = (law.K * law.R + rest + law.F) / scale;
  }
}

// Evaluates a row or coordinate in the step, and the slopes of λJ without the factor share_.
void ImplicitStep::evaluate_form(const ScalarForm& form, const Link& link,
                                 const JointVectors& start, const GeneralMotion& motion,
                                 double lambda, FormInStep* there) const {
  const auto add_slopes = [&](const RowForm& row, double weight, std::size_t f,
                              JacobianSlopes* slopes) {
    JacobianSlopes slope;
    slope.add(row.u, row.v, motion.at_force, motion.slopes[f], f);
    slope.add(row.v, row.u, motion.at_force, motion.slopes[f], f);
    slopes->add(weight, slope);
  };
  const auto gradient_of = [&](const RowForm& row, std::size_t f) {
    const VectorSlopes& slopes = motion.slopes[f];
    return (motion.at_end[row.v].transpose() * slopes.of(row.u, f) +
            motion.at_end[row.u].transpose() * slopes.of(row.v, f))
        .eval();
  };
  if (form.is_length) {
    // Discrete gradient Ḡ = ∇̄(½ d·d)/ℓ̄.
    const double end_length = motion.at_end.d.norm();
    const double length = (1.0 - share_) * start.d.norm() + share_ * end_length;
    const Vector3d n =
        end_length > 0.0 ? Vector3d(motion.at_end.d / end_length) : Vector3d(Vector3d::UnitX());
    if (length > 0.0)
      there->J = combined(1.0 / length, jacobian(form.product, motion.at_force), 0.0, {});
    there->value = end_length;
    for (std::size_t f = 0; f < 2; ++f) {
      if (link.ends[f].dofs == 0) continue;
      there->gradient[f] = n.transpose() * motion.slopes[f].d;
      if (length == 0.0) continue;
      add_slopes(form.product, 0.5 * lambda / length, f, &there->slopes[f]);
      there->slopes[f].add(there->J, -lambda / length * there->gradient[f]);
    }
    return;
  }
  if (!form.is_angle && form.product.is_custom())
    return evaluate_custom_row(link, start, motion, lambda, there);
  if (!form.is_angle) {
    there->J = jacobian(form.product, motion.at_force);
    there->value = value(form.product, motion.at_end);
    for (std::size_t f = 0; f < 2; ++f) {
      if (link.ends[f].dofs == 0) continue;
      add_slopes(form.product, lambda, f, &there->slopes[f]);
      there->gradient[f] = gradient_of(form.product, f);
    }
    return;
  }
  // Discrete gradient Ḡ = κ (c̄ ∇̄s − s̄ ∇̄c); all factors are taken at the end where forces are.
  const CosineAndSine<double> end = values(form.angle, motion.at_end);
  const CosineAndSine<double> first = share_ == 0.5 ? values(form.angle, start) : end;
  const CosineAndSine<Jacobian> J = jacobians(form.angle, motion.at_force);
  const AngleStep step(first, end);
  const double c = first.c + share_ * (end.c - first.c), s = first.s + share_ * (end.s - first.s);
  const Jacobian direction = combined(c, J.s, -s, J.c);
  there->J = combined(step.kappa, direction, 0.0, direction);
  const AngleStep whole(values(form.angle, start), end);
  there->value = whole.change;
  // Derivatives of κ = 1/(c² + s²) where forces are taken at the end.
  const double kappa_c = share_ == 0.5 ? step.kappa_c : -2.0 * end.c * step.kappa * step.kappa;
  const double kappa_s = share_ == 0.5 ? step.kappa_s : -2.0 * end.s * step.kappa * step.kappa;
  for (std::size_t f = 0; f < 2; ++f) {
    if (link.ends[f].dofs == 0) continue;
    Eigen::Matrix<double, 1, 6> of_c = Eigen::Matrix<double, 1, 6>::Zero(), of_s = of_c;
    for (const AngleForm::Term& term : form.angle.c)
      if (term.weight != 0.0) of_c += term.weight * gradient_of(term.form, f);
    for (const AngleForm::Term& term : form.angle.s)
      if (term.weight != 0.0) of_s += term.weight * gradient_of(term.form, f);
    there->gradient[f] = whole.change_c * of_c + whole.change_s * of_s;
    JacobianSlopes& slopes = there->slopes[f];
    slopes.add(direction, (lambda / share_) * (kappa_c * of_c + kappa_s * of_s));
    for (const AngleForm::Term& term : form.angle.s)
      if (term.weight != 0.0)
        add_slopes(term.form, lambda * step.kappa * c * term.weight, f, &slopes);
    for (const AngleForm::Term& term : form.angle.c)
      if (term.weight != 0.0)
        add_slopes(term.form, -lambda * step.kappa * s * term.weight, f, &slopes);
    slopes.add(J.s, lambda * step.kappa * of_c);
    slopes.add(J.c, -lambda * step.kappa * of_s);
  }
}

// Evaluates a general joint as evaluate_link() does. Forces and torques are λ times the Jacobian
// where forces are taken: for the midpoint rule at the mean vectors, which gives the discrete
// gradient.
void ImplicitStep::evaluate_general(const Link& link, Shape* shape, const Unknowns& unknowns) {
  GeneralMotion motion;
  move_general(link, *shape, unknowns, &motion);
  const JointVectors start = start_of(*shape);
  GeneralForces forces;
  shape->swing = {};
  for (int k = 0; k < link.rows; ++k) {
    const ScalarForm& form = info(link.joint).function[link.function[k]];
    const double lambda = shape->is_left_out[k] ? 0.0 : unknowns[link.unknown + k];
    FormInStep there;
    evaluate_form(form, link, start, motion, lambda, &there);
    forces.J[k] = there.J;
    forces.gradient[k] = there.gradient;
    for (std::size_t f = 0; f < 2; ++f) forces.slopes[f].add(1.0, there.slopes[f]);
    if (k < link.rigid_rows) {
      const double start_value = form.is_angle ? value(form, start) : 0.0;
      const double off = start_value + there.value - shape->offset[k];
      forces.value[k] = form.is_angle ? unwound(off, 0.0) : off;
      note_row(*shape, to_index(k),
               std::abs(forces.value[k]) * (form.has_separation() ? 1.0 : link.radius));
    } else {
      const std::size_t s = link.first_soft + to_index(k - link.rigid_rows);
      SoftRow& soft = softs_[s];
      soft.end =
          form.is_angle ? soft.start + there.value : soft.start + there.value - value(form, start);
      forces.value[k] = soft.given * lambda + soft.taken * soft.end - soft.target;
    }
    const Jacobian& J = there.J;
    forces.force += lambda * J.j3;
    forces.torque[0] += lambda * J.j2;
    forces.torque[1] += lambda * J.j4;
    shape->swing[0] += (lambda * J.j2).norm();
    shape->swing[1] += (lambda * J.j4).norm();
  }
  if (link.has_custom_force) add_custom_force(link, *shape, motion, start, unknowns, &forces);
  shape->force = forces.force;
  shape->d = motion.at_force.d;
  for (std::size_t e = 0; e < 2; ++e) {
    const End& end = link.ends[e];
    if (end.dofs == 0) continue;
    Vector(residual_.data() + end.unknown) -= s_ * end.sign * forces.force;
    if (end.dofs < 6) continue;
    Turning& turn = J_angular_[end.point];
    Vector(residual_.data() + end.unknown + 3) -= s_ * (turn.C * forces.torque[e]);
    turn.torque += forces.torque[e];
  }
  write_general(link, *shape, forces);
}

// Adds the derivatives of the force on one end of a link by the displacements of both ends.
void ImplicitStep::write_slopes(const Link& link, std::size_t e, const Matrix3d& C,
                                const std::array<JacobianSlopes, 2>& slopes, std::size_t* slot) {
  double* const values = lu_.values().data();
  const End& row = link.ends[e];
  const double* const left = left_.data() + row.unknown;
  for (std::size_t f = 0; f < 2; ++f) {
    const End& column = link.ends[f];
    if (column.dofs == 0) continue;
    Eigen::Matrix<double, 6, 6> K;
    K.topRows<3>() = (-s_ * share_ * row.sign) * slopes[f].force;
    K.bottomRows<3>() = (-s_ * share_) * C * (e == 0 ? slopes[f].torque_A : slopes[f].torque_B);
    const double* const right = right_.data() + column.unknown;
    for (int i = 0; i < row.dofs; ++i)
      for (int j = 0; j < column.dofs; ++j)
        values[slots_[(*slot)++]] += left[i] * K(i, j) * right[j];
  }
}

// Writes the blocks of a joint in the derivative, in the order of its slots, and the residuals of
// its rows.
void ImplicitStep::write_general(const Link& link, const Shape& shape,
                                 const GeneralForces& forces) {
  double* const values = lu_.values().data();
  std::size_t slot = link.slot;
  for (std::size_t e = 0; e < 2; ++e) {
    const End& row = link.ends[e];
    if (row.dofs == 0) continue;
    const double* const left = left_.data() + row.unknown;
    const Matrix3d C = row.dofs == 6 ? J_angular_[row.point].C : Matrix3d(Matrix3d::Zero());
    write_slopes(link, e, C, forces.slopes, &slot);
    std::array<Eigen::Matrix<double, 6, 1>, kMaxJointRows> columns;
    for (int k = 0; k < link.rows; ++k) {
      const Jacobian& J = forces.J[k];
      columns[k].head<3>() = -row.sign * J.j3;
      columns[k].tail<3>() = -(C * (e == 0 ? J.j2 : J.j4));
    }
    for (int i = 0; i < row.dofs; ++i) {
      for (int k = 0; k < link.rows; ++k) {
        const double scale = shape.is_left_out[k] ? 0.0 : shape.row_scale[k];
        const double taken =
            k < link.rigid_rows
                ? scale
                : scale * softs_[link.first_soft + to_index(k - link.rigid_rows)].taken;
        values[slots_[slot++]] += left[i] * columns[k][i] * scale;
        values[slots_[slot++]] += taken * forces.gradient[k][e][i] * right_[row.unknown + i];
      }
    }
  }
  for (int k = 0; k < link.rows; ++k) {
    const bool is_in = !shape.is_left_out[k];
    double diagonal = is_in ? 0.0 : 1.0;
    if (k >= link.rigid_rows)
      diagonal = left_[link.unknown + k] * right_[link.unknown + k] *
                 softs_[link.first_soft + to_index(k - link.rigid_rows)].given;
    values[slots_[slot++]] += diagonal;
    residual_[link.unknown + k] = is_in ? forces.value[k] : 0.0;
  }
}

// ---- couplings

void ImplicitStep::add_coupled(const EquationsOfMotion& equations) {
  for (const EquationsOfMotion::CoupledRow& from : equations.coupled_rows()) {
    CoupledRow coupled;
    coupled.row = from.row;
    coupled.metres = from.metres;
    for (std::size_t k = 0; k < 2; ++k) {
      coupled.terms[k].link = from.terms[k].link;
      coupled.terms[k].form = from.terms[k].form;
      coupled.terms[k].ratio = from.terms[k].ratio;
    }
    coupled_.push_back(coupled);
  }
}

// Lists the slots of couplings in the order of write_coupled(). Entries of the blocks of bodies
// were listed for the links.
void ImplicitStep::find_coupled_slots() {
  for (CoupledRow& coupled : coupled_) {
    coupled.first_slot = slots_.size();
    for (const CoupledRow::Term& term : coupled.terms) {
      for (const End& row : links_[term.link].ends) {
        for (const End& column : links_[term.link].ends)
          for (int i = 0; i < row.dofs; ++i)
            for (int j = 0; j < column.dofs; ++j)
              slots_.push_back(lu_.slot(row.unknown + i, column.unknown + j));
        for (int i = 0; i < row.dofs; ++i) {
          slots_.push_back(lu_.slot(row.unknown + i, coupled.unknown));
          slots_.push_back(lu_.slot(coupled.unknown, row.unknown + i));
        }
      }
    }
    slots_.push_back(lu_.slot(coupled.unknown, coupled.unknown));
  }
}

// Called after begin_general() of all links.
void ImplicitStep::begin_coupled(const EquationsOfMotion& equations) {
  for (std::size_t c = 0; c < coupled_.size(); ++c) {
    CoupledRow& coupled = coupled_[c];
    const EquationsOfMotion::CoupledRow& from = equations.coupled_rows()[c];
    coupled.target =
        equations.coordinates().constant(c) + equations.inputs().coupling_offset(c).value;
    double sum = 0.0;
    for (std::size_t k = 0; k < 2; ++k) {
      CoupledRow::Term& term = coupled.terms[k];
      const JointVectors vectors = start_of(shapes_[term.link]);
      term.start = term.end = reading(term.form, value(term.form, vectors), from.terms[k].zero,
                                      equations.coordinates().term(c, k));
      const Jacobian J = jacobian(term.form, vectors);
      for (std::size_t e = 0; e < 2; ++e) {
        const End& end = links_[term.link].ends[e];
        if (end.dofs == 0) continue;
        sum += term.ratio * term.ratio * J.j3.squaredNorm() / mass_[end.point];
        if (end.dofs == 6)
          sum += term.ratio * term.ratio * (e == 0 ? J.j2 : J.j4).squaredNorm() /
                 inertia_[end.point].mean();
      }
    }
    coupled.scale = sum > 0.0 ? 1.0 / std::sqrt(sum) : 1.0;
    left_[coupled.unknown] = coupled.scale;
    right_[coupled.unknown] = coupled.scale / s_;
  }
}

void ImplicitStep::evaluate_coupled(CoupledRow* coupled, const Unknowns& unknowns) {
  const double lambda = coupled->is_left_out ? 0.0 : unknowns[coupled->unknown];
  const double scale = coupled->is_left_out ? 0.0 : coupled->scale;
  double off = -coupled->target;
  std::size_t slot = coupled->first_slot;
  for (CoupledRow::Term& term : coupled->terms) {
    const Link& link = links_[term.link];
    Shape& shape = shapes_[term.link];
    GeneralMotion motion;
    move_general(link, shape, unknowns, &motion);
    const JointVectors start = start_of(shape);
    FormInStep there;
    evaluate_form(term.form, link, start, motion, term.ratio * lambda, &there);
    term.end = term.form.is_angle ? term.start + there.value
                                  : term.start + there.value - value(term.form, start);
    off += term.ratio * term.end;
    const double force = term.ratio * lambda;
    for (std::size_t e = 0; e < 2; ++e) {
      const End& end = link.ends[e];
      if (end.dofs == 0) continue;
      Vector(residual_.data() + end.unknown) -= s_ * end.sign * force * there.J.j3;
      if (end.dofs < 6) continue;
      const Vector3d torque = force * (e == 0 ? there.J.j2 : there.J.j4);
      Turning& turn = J_angular_[end.point];
      Vector(residual_.data() + end.unknown + 3) -= s_ * (turn.C * torque);
      turn.torque += torque;
      shape.swing[e] += torque.norm();
    }
    write_coupled(term, there, scale, &slot);
  }
  double& worst = coupled->is_left_out ? worst_momentary_row_ : worst_row_;
  if (!coupled->is_redundant) worst = larger(worst, coupled->metres * std::abs(off));
  lu_.values()[slots_[slot]] += coupled->is_left_out ? 1.0 : 0.0;
  residual_[coupled->unknown] = coupled->is_left_out ? 0.0 : off;
}

// Adds the blocks of one term to the derivative, in the order of its slots.
void ImplicitStep::write_coupled(const CoupledRow::Term& term, const FormInStep& there,
                                 double scale, std::size_t* slot) {
  double* const values = lu_.values().data();
  const Link& link = links_[term.link];
  for (std::size_t e = 0; e < 2; ++e) {
    const End& row = link.ends[e];
    if (row.dofs == 0) continue;
    const double* const left = left_.data() + row.unknown;
    const Matrix3d C = row.dofs == 6 ? J_angular_[row.point].C : Matrix3d(Matrix3d::Zero());
    write_slopes(link, e, C, there.slopes, slot);
    Eigen::Matrix<double, 6, 1> push;
    push.head<3>() = -row.sign * term.ratio * there.J.j3;
    push.tail<3>() = -term.ratio * (C * (e == 0 ? there.J.j2 : there.J.j4));
    for (int i = 0; i < row.dofs; ++i) {
      values[slots_[(*slot)++]] += left[i] * push[i] * scale;
      values[slots_[(*slot)++]] +=
          scale * term.ratio * there.gradient[e][i] * right_[row.unknown + i];
    }
  }
}

}  // namespace constraint_sim::engine
