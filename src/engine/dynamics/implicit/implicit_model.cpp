#include "engine/dynamics/implicit/implicit_model.h"

#include <algorithm>

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

}  // namespace

ImplicitModel::ImplicitModel(const EquationsOfMotion& equations) {
  for (std::size_t i = 0; i < equations.bodies().size(); ++i)
    mass_.push_back(1.0 / equations.inverse_mass(i));
  for (std::size_t i = 0; i < equations.rotating(); ++i) {
    inertia_.push_back(equations.inertia(i));
    radius_.push_back(equations.radius_of_gyration(i));
  }
  for (std::size_t l = 0; l < equations.links().size(); ++l) add_link(equations, l);
  for (const EquationsOfMotion::SoftCoordinate& soft : equations.soft_coordinates())
    has_dampers_ = has_dampers_ || soft.law.C > 0.0;
  for (const EquationsOfMotion::CoupledRow& from : equations.coupled_rows()) {
    ImplicitCoupling& coupling = couplings_.emplace_back();
    coupling.row = from.row;
    coupling.metres = from.metres;
    for (std::size_t k = 0; k < 2; ++k)
      coupling.terms[k] = {from.terms[k].link, from.terms[k].form, from.terms[k].ratio};
  }
  make_nodes(equations);
}

void ImplicitModel::add_link(const EquationsOfMotion& equations, std::size_t l) {
  using Kind = ImplicitLink::Kind;
  const EquationsOfMotion::Link& from = equations.links()[l];
  ImplicitLink link;
  link.index = l;
  link.kind = equations.is_rod(l)       ? Kind::kRod
              : equations.is_ball(l)    ? Kind::kBall
              : equations.is_general(l) ? Kind::kGeneral
                                        : Kind::kSpring;
  link.rigid_rows = static_cast<int>(equations.rows_of(l));
  link.rows = link.rigid_rows + static_cast<int>(from.softs);
  link.function = from.function;
  link.first_soft = from.first_soft;
  for (int k = link.rigid_rows; k < link.rows; ++k)
    link.function[to_index(k)] =
        static_cast<std::uint8_t>(equations.soft_coordinates()[link.soft_of(k)].function);
  link.joint = from.kind;
  link.frames = {from.frame_a, from.frame_b};
  link.radius = from.radius;
  if (link.kind == Kind::kGeneral) extent_ = std::max(extent_, link.radius);
  const auto end = [&](std::size_t point, const Vector3d& anchor, double sign) {
    const int dofs = point < rotating() ? 6 : (point < bodies() ? 3 : 0);
    if (dofs == 6) extent_ = std::max(extent_, anchor.norm());
    return ImplicitEnd{point, -1, dofs, anchor, sign};
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

double ImplicitModel::response(const ImplicitLink& link, const Jacobian& J) const {
  double sum = 0.0;
  for (std::size_t e = 0; e < 2; ++e) {
    const ImplicitEnd& end = link.ends[e];
    if (end.dofs == 0) continue;
    sum += J.j3.squaredNorm() / mass_[end.point];
    if (end.dofs == 6) sum += (e == 0 ? J.j2 : J.j4).squaredNorm() / inertia_[end.point].mean();
  }
  return sum;
}

// Spanning forest of the bodies. Roots are held by the world where any body is; bodies are listed
// in the order in which they were found, with place and parent.
struct ImplicitModel::Forest {
  List<std::size_t> found;
  List<int> parent, place;

  /// Number of the body's node in SaddleLu, which eliminates in reverse order.
  int node_of(std::size_t body) const { return static_cast<int>(place.size()) - 1 - place[body]; }
};

ImplicitModel::Forest ImplicitModel::find_forest() const {
  List<List<std::size_t>> links_of(bodies());
  List<std::size_t> roots;
  for (std::size_t l = 0; l < links_.size(); ++l) {
    const auto& ends = links_[l].ends;
    for (std::size_t e = 0; e < 2; ++e) {
      if (ends[e].dofs == 0) continue;
      links_of[ends[e].point].push_back(l);
      if (ends[1 - e].dofs == 0) roots.push_back(ends[e].point);
    }
  }
  for (std::size_t i = 0; i < bodies(); ++i) roots.push_back(i);

  Forest forest{{}, List<int>(bodies(), -1), List<int>(bodies(), -1)};
  auto& [found, parent, place] = forest;
  for (const std::size_t root : roots) {
    if (place[root] >= 0) continue;
    place[root] = static_cast<int>(found.size());
    found.push_back(root);
    for (std::size_t k = to_index(place[root]); k < found.size(); ++k) {
      for (const std::size_t l : links_of[found[k]]) {
        const auto& ends = links_[l].ends;
        const std::size_t other = ends[0].point == found[k] ? ends[1].point : ends[0].point;
        if (other >= bodies() || place[other] >= 0) continue;
        place[other] = static_cast<int>(found.size());
        parent[other] = static_cast<int>(found[k]);
        found.push_back(other);
      }
    }
  }
  return forest;
}

// Assigns the rows between two bodies to the body further from the root.
ImplicitModel::RowsOfBodies ImplicitModel::share_rows(const Forest& forest) const {
  RowsOfBodies rows{List<List<std::size_t>>(bodies()), List<List<std::size_t>>(bodies()), false};
  for (std::size_t l = 0; l < links_.size(); ++l) {
    const ImplicitEnd& a = links_[l].ends[0];
    const ImplicitEnd& b = links_[l].ends[1];
    std::size_t lower = a.dofs > 0 ? a.point : b.point;
    if (a.dofs > 0 && b.dofs > 0) {
      if (forest.place[b.point] > forest.place[a.point]) lower = b.point;
      const std::size_t upper = lower == a.point ? b.point : a.point;
      rows.have_loops = rows.have_loops || forest.parent[lower] != static_cast<int>(upper);
    }
    rows.links[lower].push_back(l);
  }
  for (std::size_t c = 0; c < couplings_.size(); ++c) {
    const auto& ends = links_[couplings_[c].terms[0].link].ends;
    rows.coupled[ends[1].dofs > 0 ? ends[1].point : ends[0].point].push_back(c);
  }
  return rows;
}

// Creates a node per body, from the leaves to a root, each with the unknowns of its rows.
void ImplicitModel::make_nodes(const EquationsOfMotion& equations) {
  const Forest forest = find_forest();
  const RowsOfBodies rows = share_rows(forest);
  nodes_.resize(bodies());
  first_unknown_.assign(bodies(), 0);
  int unknown = 0;
  for (std::size_t k = bodies(); k-- > 0;) {
    const std::size_t body = forest.found[k];
    SaddleLu::Node& node = nodes_[forest.node_of(body)];
    node.dofs = body < rotating() ? 6 : 3;
    node.parent = forest.parent[body] < 0 ? -1 : forest.node_of(to_index(forest.parent[body]));
    first_unknown_[body] = unknown;
    unknown += node.dofs;
    for (const std::size_t l : rows.links[body]) {
      links_[l].unknown = unknown;
      unknown += links_[l].rows;
      node.rows += links_[l].rows;
    }
    for (const std::size_t c : rows.coupled[body]) {
      couplings_[c].unknown = unknown++;
      ++node.rows;
    }
    may_depend_ = may_depend_ || rows.links[body].size() > 1 || !rows.coupled[body].empty();
  }
  may_depend_ = (may_depend_ || rows.have_loops) && equations.rows() > 0;
  for (ImplicitLink& link : links_)
    for (ImplicitEnd& end : link.ends)
      if (end.dofs > 0) end.unknown = first_unknown_[end.point];
  make_blocks(forest, rows);
}

// Describes the rows for SaddleLu; rows of couplings come last.
void ImplicitModel::make_blocks(const Forest& forest, const RowsOfBodies& rows) {
  blocks_.resize(links_.size());
  for (std::size_t body = 0; body < bodies(); ++body) {
    for (const std::size_t l : rows.links[body]) {
      const auto& ends = links_[l].ends;
      const ImplicitEnd& other = ends[ends[0].point == body ? 1 : 0];
      blocks_[l] = {links_[l].unknown, links_[l].rows, forest.node_of(body),
                    other.dofs > 0 ? forest.node_of(other.point) : -1};
    }
  }
  for (std::size_t body = 0; body < bodies(); ++body) {
    for (const std::size_t c : rows.coupled[body]) {
      List<int> others;  // nodes besides the own node
      for (const ImplicitCoupling::Term& term : couplings_[c].terms) {
        for (const ImplicitEnd& end : links_[term.link].ends) {
          if (end.dofs == 0 || end.point == body) continue;
          const int node = forest.node_of(end.point);
          if (std::find(others.begin(), others.end(), node) == others.end()) others.push_back(node);
        }
      }
      others.resize(3, -1);
      blocks_.push_back(
          {couplings_[c].unknown, 1, forest.node_of(body), others[0], {others[1], others[2]}});
    }
  }
}

}  // namespace constraint_sim::engine
