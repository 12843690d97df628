#include "engine/impulses/row_system.h"

namespace constraint_sim::engine {

using Eigen::Vector3d;

void RowSystem::begin(const List<int>& moved, const Bodies& bodies) {
  before_.resize(bodies.size());
  for (const int i : moved)
    before_[i] = twist(bodies[i].linear_velocity, bodies[i].angular_velocity);
}

void RowSystem::load(const List<int>& moved, const Bodies& bodies, const Masses& masses,
                     const Vector3d& gravity, double h, const List<Row>& rows) {
  h_ = h;
  any_corrections_ = false;
  prepare_bodies(moved, bodies, masses, rows);
  for (const int i : moved) velocities_[i].head<3>() += h * masses[i].weight_share * gravity;
  if (rows.empty()) return;
  by_loads_.resize(bodies.size());
  for (const int i : moved) by_loads_[i] = change(to_index(i)).head<3>();
  connect(rows);
  respond(rows);
}

void RowSystem::prepare_bodies(const List<int>& moved, const Bodies& bodies, const Masses& masses,
                               const List<Row>& rows) {
  velocities_.resize(bodies.size());
  corrections_.resize(bodies.size());
  if (rows.empty()) {
    for (const int i : moved) {
      velocities_[i] = twist(bodies[i].linear_velocity, bodies[i].angular_velocity);
      corrections_[i].setZero();
    }
    return;
  }
  inertias_.resize(bodies.size());
  effects_.resize(bodies.size());
  connected_.resize(bodies.size());
  components_.resize(bodies.size());
  for (const Row& row : rows)  // kinematic and static bodies
    for (const int body : {row.body_a, row.body_b})
      if (!masses[body].is_movable()) {
        prepare_body(body, false, bodies, masses);
        before_[body] = velocities_[body];
      }
  for (const int i : moved) prepare_body(i, true, bodies, masses);
}

void RowSystem::prepare_body(int index, bool is_moved, const Bodies& bodies, const Masses& masses) {
  const std::size_t i = to_index(index);
  velocities_[i] = twist(bodies[i].linear_velocity, bodies[i].angular_velocity);
  corrections_[i].setZero();
  effects_[i].setZero();
  connected_.isolate(index);
  components_[i] = Component{};
  Inertia& inertia = inertias_[i];
  inertia.is_moved = is_moved;
  inertia.inverse_mass = is_moved ? masses[i].inverse_mass : 0.0;
  inertia.can_turn = is_moved && masses[i].can_turn();
  if (!inertia.can_turn) return;
  inertia.R = bodies[i].orientation.toRotationMatrix();
  inertia.principal = masses[i].inertia;
  inertia.inverse_W = inertia.R * masses[i].inverse_inertia.asDiagonal() * inertia.R.transpose();
}

// Connects bodies to components by their rows.
void RowSystem::connect(const List<Row>& rows) {
  const auto moved_body = [this](const Row& row) {
    return is_moved(row.body_a) ? row.body_a : row.body_b;
  };
  for (const Row& row : rows) {
    if (row.normal_row == Row::kCoupledPart)
      connected_.join(moved_body(*(&row - 1)), moved_body(row));
    if (!is_moved(row.body_a) || !is_moved(row.body_b)) continue;
    connected_.join(row.body_a, row.body_b);
  }
}

// Computes M⁻¹ Jᵀ and the effective mass of each row, at the positions before the step.
void RowSystem::respond(const List<Row>& rows) {
  responses_.resize(rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Row& row = rows[i];
    const Inertia& a = inertias_[row.body_a];
    const Inertia& b = inertias_[row.body_b];
    RowResponse& r = responses_[i];
    r.J_A = twist(row.J.j1, row.J.j2);
    r.J_B = twist(row.J.j3, row.J.j4);
    const auto apply_inverse_mass = [](const Inertia& inertia, const Twist& J) {
      Twist result = Twist::Zero();
      result.head<3>() = inertia.inverse_mass * J.head<3>();
      if (inertia.can_turn) result.tail<3>() = inertia.inverse_W * J.tail<3>();
      return result;
    };
    r.response_a = apply_inverse_mass(a, r.J_A);
    r.response_b = apply_inverse_mass(b, r.J_B);
    r.K = r.J_A.dot(r.response_a) + r.J_B.dot(r.response_b);
    if (row.normal_row == Row::kCoupledPart) join_parts(rows[i - 1], row, &r);
    const double constraint_mass = r.K + row.softness;
    r.effective_mass = constraint_mass > 0.0 ? 1.0 / constraint_mass : 0.0;
    r.component = component_of(a.is_moved ? row.body_a : row.body_b);
    if (!a.is_moved || !b.is_moved) components_[r.component].is_attached = true;
  }
  find_corrections(rows);
}

void RowSystem::find_corrections(const List<Row>& rows) {
  for (std::size_t i = 0; i < rows.size(); ++i)
    if (rows[i].correction != 0.0)
      components_[responses_[i].component].corrects = any_corrections_ = true;
  for (RowResponse& r : responses_)
    r.corrects = any_corrections_ && components_[r.component].corrects;
}

// Joins both parts of a coupled row: K = J M⁻¹ Jᵀ of the sum of the parts.
void RowSystem::join_parts(const Row& first, const Row& second, RowResponse* of_second) {
  RowResponse& of_first = *(of_second - 1);
  double across = 0.0;
  if (first.body_a == second.body_a) across += of_first.J_A.dot(of_second->response_a);
  if (first.body_a == second.body_b) across += of_first.J_A.dot(of_second->response_b);
  if (first.body_b == second.body_a) across += of_first.J_B.dot(of_second->response_a);
  if (first.body_b == second.body_b) across += of_first.J_B.dot(of_second->response_b);
  of_first.K = of_second->K += of_first.K + 2.0 * across;
  of_first.effective_mass = of_first.K > 0.0 ? 1.0 / of_first.K : 0.0;
}

double RowSystem::kinetic_energy(int body, const Twist& v) const {
  const Inertia& inertia = inertias_[body];
  double twice = v.head<3>().squaredNorm() / inertia.inverse_mass;
  if (inertia.can_turn) {
    const Vector3d w = inertia.R.transpose() * v.tail<3>();
    twice += w.dot(inertia.principal.cwiseProduct(w));
  }
  return 0.5 * twice;
}

}  // namespace constraint_sim::engine
