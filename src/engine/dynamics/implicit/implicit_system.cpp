#include "engine/dynamics/implicit/implicit_system.h"

#include <algorithm>
#include <cmath>

#include "engine/math/cross_matrix.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

}  // namespace

ImplicitSystem::ImplicitSystem(const ImplicitModel& model) {
  lu_.analyze(model.nodes(), model.blocks());
  find_slots(model);
  left_.assign(lu_.size(), 1.0);
  right_ = left_;
  residual_ = left_;
  torque_.assign(model.rotating(), Vector3d::Zero());
}

// Lists the entries of the derivative that links, couplings and bodies add to, in the order in
// which they are added: by end, its blocks with both ends, then its entries with all rows.
void ImplicitSystem::find_slots(const ImplicitModel& model) {
  const auto add = [&](int i, int j) { slots_.push_back(lu_.slot(i, j)); };
  const auto add_ends = [&](const ImplicitLink& link, int unknown, int rows) {
    for (const ImplicitEnd& row : link.ends) {
      for (const ImplicitEnd& column : link.ends)
        for (int i = 0; i < row.dofs; ++i)
          for (int j = 0; j < column.dofs; ++j) add(row.unknown + i, column.unknown + j);
      for (int i = 0; i < row.dofs; ++i) {
        for (int k = 0; k < rows; ++k) {
          add(row.unknown + i, unknown + k);
          add(unknown + k, row.unknown + i);
        }
      }
    }
  };
  const auto add_rod = [&](const ImplicitLink& link) {  // Blocks of a rod are diagonal.
    for (const ImplicitEnd& row : link.ends) {
      for (const ImplicitEnd& column : link.ends)
        for (int k = 0; k < 3 && row.dofs > 0 && column.dofs > 0; ++k)
          add(row.unknown + k, column.unknown + k);
      for (int k = 0; k < row.dofs; ++k) {
        add(row.unknown + k, link.unknown);
        add(link.unknown, row.unknown + k);
      }
    }
  };
  for (const ImplicitLink& link : model.links()) {
    first_slot_.push_back(slots_.size());
    if (link.is_between_points)
      add_rod(link);
    else
      add_ends(link, link.unknown, link.rows);
    for (int k = 0; k < link.rows; ++k) add(link.unknown + k, link.unknown + k);
  }
  for (const ImplicitCoupling& coupling : model.couplings()) {
    first_coupled_slot_.push_back(slots_.size());
    for (const ImplicitCoupling::Term& term : coupling.terms)
      add_ends(model.links()[term.link], coupling.unknown, 1);
    add(coupling.unknown, coupling.unknown);
  }
  for (std::size_t i = 0; i < model.bodies(); ++i) {
    const int first = static_cast<int>(model.first_unknown(i));
    for (int k = 0; k < 3; ++k) diagonal_.push_back(lu_.slot(first + k, first + k));
    if (i >= model.rotating()) continue;
    for (int k = 3; k < 6; ++k)
      for (int m = 3; m < 6; ++m) diagonal_.push_back(lu_.slot(first + k, first + m));
  }
}

void ImplicitSystem::begin(const ImplicitModel& model, const ImplicitTime& time) {
  s_ = time.s;
  for (std::size_t i = 0; i < model.bodies(); ++i) {
    const auto set = [&](std::size_t first, double scale) {
      for (std::size_t u = first; u < first + 3; ++u) left_[u] = right_[u] = scale;
    };
    set(model.first_unknown(i), 1.0 / std::sqrt(model.mass(i)));
    if (i < model.rotating())
      set(model.first_unknown(i) + 3, 1.0 / std::sqrt(model.inertia(i).mean()));
  }
}

void ImplicitSystem::clear() {
  std::fill(lu_.values().begin(), lu_.values().end(), 0.0);
  worst_row_ = worst_momentary_row_ = 0.0;
}

void ImplicitSystem::finish(const ImplicitModel& model) {
  Entries entries = entries_of_bodies();
  for (std::size_t i = 0; i < model.rotating(); ++i) {
    entries.skip(3);
    const double scale = scale_of(model.first_unknown(i) + 3);
    const Eigen::Matrix3d change = (-0.5 * s_ * scale) * cross_matrix(torque_[i]);
    for (int k = 0; k < 3; ++k)
      for (int m = 0; m < 3; ++m) entries.add(change(k, m));
  }
  for (std::size_t u = 0; u < residual_.size(); ++u) residual_[u] *= left_[u];
}

double ImplicitSystem::add(const ImplicitModel& model, const double* change,
                           List<double>* unknowns) const {
  double largest = 0.0;
  const auto consider = [&](double scale, const double* first) {
    largest = larger(largest, scale * scale * Eigen::Map<const Vector3d>(first).squaredNorm());
  };
  for (std::size_t u = 0; u < unknowns->size(); ++u) (*unknowns)[u] += right_[u] * change[u];
  for (std::size_t i = 0; i < model.bodies(); ++i) {
    const std::size_t first = model.first_unknown(i);
    consider(right_[first], change + first);
    if (i < model.rotating())
      consider(right_[first + 3] * model.radius_of_gyration(i), change + first + 3);
  }
  return std::sqrt(largest);
}

}  // namespace constraint_sim::engine
