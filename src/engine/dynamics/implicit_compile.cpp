// Compilation of an ImplicitStep: numbering of unknowns and elimination order.

#include <algorithm>

#include "engine/dynamics/implicit_step.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

}  // namespace

ImplicitStep::ImplicitStep(const EquationsOfMotion& equations)
    : bodies_(equations.bodies().size()), rotating_(equations.rotating()) {
  for (std::size_t i = 0; i < bodies_; ++i) mass_.push_back(1.0 / equations.inverse_mass(i));
  for (std::size_t i = 0; i < rotating_; ++i) {
    inertia_.push_back(equations.inertia(i));
    radius_.push_back(equations.radius_of_gyration(i));
  }
  for (std::size_t l = 0; l < equations.links().size(); ++l) {
    const EquationsOfMotion::Link& from = equations.links()[l];
    Link link;
    link.kind = equations.is_rod(l)       ? Kind::kRod
                : equations.is_ball(l)    ? Kind::kBall
                : equations.is_general(l) ? Kind::kGeneral
                                          : Kind::kSpring;
    link.rigid_rows = static_cast<int>(equations.rows_of(l));
    link.rows = link.rigid_rows + static_cast<int>(from.softs);
    link.function = from.function;
    link.first_soft = from.first_soft;
    for (std::size_t s = 0; s < from.softs; ++s)
      link.function[to_index(link.rigid_rows) + s] =
          static_cast<std::uint8_t>(equations.soft_coordinates()[from.first_soft + s].function);
    link.joint = from.kind;
    link.frames = {from.frame_a, from.frame_b};
    link.radius = from.radius;
    const auto end = [&](std::size_t point, const Vector3d& anchor, double sign) {
      End e;
      e.point = point;
      e.dofs = point < rotating_ ? 6 : (point < bodies_ ? 3 : 0);
      e.anchor = anchor;
      e.sign = sign;
      return e;
    };
    link.ends[0] = end(from.a, from.anchor_a, -1.0);
    link.ends[1] = end(from.b, from.anchor_b, 1.0);
    link.is_between_points =
        link.kind == Kind::kRod && link.ends[0].dofs < 6 && link.ends[1].dofs < 6;
    link.stiffness = from.stiffness;
    link.damping = from.damping;
    link.custom = from.custom;
    link.has_custom_force = from.has_custom_force();
    // Custom forces may dissipate energy, which is not known in advance.
    has_dampers_ = has_dampers_ || link.damping > 0.0 || link.has_custom_force;
    links_.push_back(link);
  }
  if (!equations.coupled_rows().empty()) add_coupled(equations);
  make_nodes(equations);
  find_slots();

  const std::size_t points = equations.points();
  for (auto* list : {&x_, &v_, &shift_}) list->assign(points, Vector3d::Zero());
  for (auto* list : {&force_, &torque_, &p_, &dx_before_, &v_before_, &w_before_, &L_before_})
    list->assign(bodies_, Vector3d::Zero());
  q_.assign(rotating_, Eigen::Quaterniond::Identity());
  angular_velocity_.assign(rotating_, Vector3d::Zero());
  J_angular_.resize(rotating_);
  shapes_.resize(links_.size());
  softs_.resize(equations.soft_coordinates().size());
  for (const EquationsOfMotion::SoftCoordinate& soft : equations.soft_coordinates())
    has_dampers_ = has_dampers_ || soft.law.C > 0.0;
  left_.assign(lu_.size(), 1.0);
  right_ = left_;
  residual_ = left_;
  squares_.assign(bodies_, 0.0);
}

// Spanning forest of the bodies. Roots are held by the world where any body is; bodies are listed
// in the order in which they were found, with place and parent.
struct ImplicitStep::Forest {
  List<std::size_t> found;
  List<int> parent, place;

  /// Number of the body's node in SaddleLu, which eliminates in reverse order.
  int node_of(std::size_t body) const { return static_cast<int>(place.size()) - 1 - place[body]; }
};

ImplicitStep::Forest ImplicitStep::find_forest() const {
  List<List<std::size_t>> links_of(bodies_);
  List<std::size_t> roots;
  for (std::size_t l = 0; l < links_.size(); ++l) {
    const auto& ends = links_[l].ends;
    for (std::size_t e = 0; e < 2; ++e) {
      if (ends[e].dofs == 0) continue;
      links_of[ends[e].point].push_back(l);
      if (ends[1 - e].dofs == 0) roots.push_back(ends[e].point);
    }
  }
  for (std::size_t i = 0; i < bodies_; ++i) roots.push_back(i);

  Forest forest{{}, List<int>(bodies_, -1), List<int>(bodies_, -1)};
  auto& [found, parent, place] = forest;
  for (const std::size_t root : roots) {
    if (place[root] >= 0) continue;
    place[root] = static_cast<int>(found.size());
    found.push_back(root);
    for (std::size_t k = to_index(place[root]); k < found.size(); ++k) {
      for (const std::size_t l : links_of[found[k]]) {
        const auto& ends = links_[l].ends;
        const std::size_t other = ends[0].point == found[k] ? ends[1].point : ends[0].point;
        if (other >= bodies_ || place[other] >= 0) continue;
        place[other] = static_cast<int>(found.size());
        parent[other] = static_cast<int>(found[k]);
        found.push_back(other);
      }
    }
  }
  return forest;
}

// Assigns the rows between two bodies to the body further from the root.
ImplicitStep::RowsOfBodies ImplicitStep::share_rows(const Forest& forest) {
  RowsOfBodies rows{List<List<std::size_t>>(bodies_), List<List<std::size_t>>(bodies_), false};
  for (std::size_t l = 0; l < links_.size(); ++l) {
    const End& a = links_[l].ends[0];
    const End& b = links_[l].ends[1];
    std::size_t lower = a.dofs > 0 ? a.point : b.point;
    if (a.dofs > 0 && b.dofs > 0) {
      if (forest.place[b.point] > forest.place[a.point]) lower = b.point;
      const std::size_t upper = lower == a.point ? b.point : a.point;
      rows.have_loops = rows.have_loops || forest.parent[lower] != static_cast<int>(upper);
    }
    rows.links[lower].push_back(l);
  }
  for (std::size_t c = 0; c < coupled_.size(); ++c) {
    const auto& ends = links_[coupled_[c].terms[0].link].ends;
    rows.coupled[ends[1].dofs > 0 ? ends[1].point : ends[0].point].push_back(c);
  }
  return rows;
}

// Creates a node per body, from the leaves to a root, each with the unknowns of its rows.
void ImplicitStep::make_nodes(const EquationsOfMotion& equations) {
  const Forest forest = find_forest();
  const RowsOfBodies rows = share_rows(forest);
  List<SaddleLu::Node> nodes(bodies_);
  first_unknown_.assign(bodies_, 0);
  int unknown = 0;
  for (std::size_t k = bodies_; k-- > 0;) {
    const std::size_t body = forest.found[k];
    SaddleLu::Node& node = nodes[forest.node_of(body)];
    node.dofs = body < rotating_ ? 6 : 3;
    node.parent = forest.parent[body] < 0 ? -1 : forest.node_of(to_index(forest.parent[body]));
    first_unknown_[body] = unknown;
    unknown += node.dofs;
    for (const std::size_t l : rows.links[body]) {
      links_[l].unknown = unknown;
      unknown += links_[l].rows;
      node.rows += links_[l].rows;
    }
    for (const std::size_t c : rows.coupled[body]) {
      coupled_[c].unknown = unknown++;
      ++node.rows;
    }
    may_depend_ = may_depend_ || rows.links[body].size() > 1 || !rows.coupled[body].empty();
  }
  may_depend_ = (may_depend_ || rows.have_loops) && equations.rows() > 0;
  for (Link& link : links_)
    for (End& end : link.ends)
      if (end.dofs > 0) end.unknown = first_unknown_[end.point];
  lu_.analyze(nodes, rows_between(forest, rows));
}

// Describes the rows for SaddleLu; rows of couplings come last.
List<SaddleLu::Link> ImplicitStep::rows_between(const Forest& forest,
                                                const RowsOfBodies& rows) const {
  List<SaddleLu::Link> links(links_.size());
  for (std::size_t body = 0; body < bodies_; ++body) {
    for (const std::size_t l : rows.links[body]) {
      const auto& ends = links_[l].ends;
      const End& other = ends[ends[0].point == body ? 1 : 0];
      links[l] = {links_[l].unknown, links_[l].rows, forest.node_of(body),
                  other.dofs > 0 ? forest.node_of(other.point) : -1};
    }
  }
  for (std::size_t body = 0; body < bodies_; ++body) {
    for (const std::size_t c : rows.coupled[body]) {
      List<int> others;  // nodes besides the own node
      for (const CoupledRow::Term& term : coupled_[c].terms) {
        for (const End& end : links_[term.link].ends) {
          if (end.dofs == 0 || end.point == body) continue;
          const int node = forest.node_of(end.point);
          if (std::find(others.begin(), others.end(), node) == others.end()) others.push_back(node);
        }
      }
      others.resize(3, -1);
      links.push_back(
          {coupled_[c].unknown, 1, forest.node_of(body), others[0], {others[1], others[2]}});
    }
  }
  return links;
}

// Lists the matrix entries that links add to, in the order in which they are added.
void ImplicitStep::find_slots() {
  for (Link& link : links_) {
    link.slot = slots_.size();
    if (link.is_between_points) {
      for (const End& row : link.ends) {
        for (const End& column : link.ends)
          for (int k = 0; k < 3 && row.dofs > 0 && column.dofs > 0; ++k)
            slots_.push_back(lu_.slot(row.unknown + k, column.unknown + k));
        for (int k = 0; k < row.dofs; ++k) {
          slots_.push_back(lu_.slot(row.unknown + k, link.unknown));
          slots_.push_back(lu_.slot(link.unknown, row.unknown + k));
        }
      }
      slots_.push_back(lu_.slot(link.unknown, link.unknown));
      continue;
    }
    for (const End& row : link.ends) {
      for (const End& column : link.ends)
        for (int i = 0; i < row.dofs; ++i)
          for (int j = 0; j < column.dofs; ++j)
            slots_.push_back(lu_.slot(row.unknown + i, column.unknown + j));
      for (int i = 0; i < row.dofs; ++i) {
        for (int k = 0; k < link.rows; ++k) {
          slots_.push_back(lu_.slot(row.unknown + i, link.unknown + k));
          slots_.push_back(lu_.slot(link.unknown + k, row.unknown + i));
        }
      }
    }
    for (int k = 0; k < link.rows; ++k)
      slots_.push_back(lu_.slot(link.unknown + k, link.unknown + k));
  }
  if (!coupled_.empty()) find_coupled_slots();
  for (std::size_t i = 0; i < bodies_; ++i) {
    const int first = first_unknown_[i];
    for (int k = 0; k < 3; ++k) diagonal_.push_back(lu_.slot(first + k, first + k));
    if (i >= rotating_) continue;
    for (int k = 3; k < 6; ++k)
      for (int m = 3; m < 6; ++m) diagonal_.push_back(lu_.slot(first + k, first + m));
  }
}

}  // namespace constraint_sim::engine
