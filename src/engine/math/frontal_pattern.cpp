// Symbolic analysis of FrontalLu: the order of the elimination, and its fronts.

#include <Eigen/OrderingMethods>
#include <Eigen/SparseCore>
#include <algorithm>

#include "engine/math/frontal_lu.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {
namespace {

// Most zeros that a front may store to take in its children: a share of the entries, plus a number.
constexpr double kInVain = 0.1;
constexpr std::size_t kFewInVain = 100;

// Returns the place of each body in an elimination with little fill.
List<std::size_t> little_fill_order(std::size_t n, const List<FrontalLu::Link>& links) {
  List<Eigen::Triplet<double>> triplets;
  const auto size = static_cast<int>(n);
  triplets.reserve(n + 2 * links.size());
  for (int i = 0; i < size; ++i) triplets.emplace_back(i, i, 1.0);
  for (const FrontalLu::Link& link : links) {
    const std::array<int, 4> all{link.body, link.other, link.more[0], link.more[1]};
    for (std::size_t i = 0; i < all.size(); ++i) {
      for (std::size_t k = 0; k < i; ++k) {
        if (all[i] < 0 || all[k] < 0) continue;
        triplets.emplace_back(all[k], all[i], 1.0);
        triplets.emplace_back(all[i], all[k], 1.0);
      }
    }
  }
  Eigen::SparseMatrix<double> pattern(size, size);
  pattern.setFromTriplets(triplets.begin(), triplets.end());
  Eigen::AMDOrdering<int>::PermutationType permutation;
  Eigen::AMDOrdering<int>()(pattern, permutation);
  List<std::size_t> order(n);
  for (std::size_t k = 0; k < n; ++k)
    order[permutation.indices()[static_cast<Eigen::Index>(k)]] = k;
  return order;
}

void sort_unique(List<std::size_t>* list) {
  std::sort(list->begin(), list->end());
  list->erase(std::unique(list->begin(), list->end()), list->end());
}

}  // namespace

// Bodies with their assigned rows, in the order of the elimination.
struct FrontalLu::Groups {
  List<List<std::size_t>> own, border;  // unknowns of each group, and of its border
  List<List<std::size_t>> couples;      // unknowns of later groups that couple with a group
  List<std::size_t> group_of;           // group of each unknown
  List<std::size_t> parent;             // parent of each group; a root is its own parent
  List<char> is_joined;                 // whether a group is joined to its parent
};

void FrontalLu::analyze(const List<Body>& bodies, const List<Link>& links) {
  n_ = 0;
  for (const Body& body : bodies) n_ += to_index(body.dofs);
  for (const Link& link : links) n_ += to_index(link.rows);
  find_pattern(bodies, links);
  Groups groups = find_groups(bodies, links);
  find_borders(&groups);
  join(&groups);
  make_fronts(groups);
  for (auto* list : {&solution_, &residual_, &change_}) list->assign(n_, 0.0);
  has_factors_ = false;
}

void FrontalLu::find_pattern(const List<Body>& bodies, const List<Link>& links) {
  List<List<std::size_t>> columns(n_);
  const auto couple = [&](int first, int count, int other, int others) {
    for (int i = first; i < first + count; ++i)
      for (int j = other; j < other + others; ++j) {
        columns[i].push_back(to_index(j));
        columns[j].push_back(to_index(i));
      }
  };
  for (const Body& body : bodies) couple(body.first, body.dofs, body.first, body.dofs);
  for (const Link& link : links) {
    const Body& body = bodies[link.body];
    couple(link.first, link.rows, link.first, link.rows);
    couple(link.first, link.rows, body.first, body.dofs);
    for (const int further : link.more)
      if (further >= 0) couple(link.first, link.rows, bodies[further].first, bodies[further].dofs);
    if (link.other < 0) continue;
    const Body& other = bodies[link.other];
    couple(link.first, link.rows, other.first, other.dofs);
    couple(body.first, body.dofs, other.first, other.dofs);
  }
  row_begin_.assign(1, 0);
  column_.clear();
  for (auto& row : columns) {
    sort_unique(&row);
    column_.insert(column_.end(), row.begin(), row.end());
    row_begin_.push_back(column_.size());
  }
}

// Assigns rows to the first of their bodies, so that they appear in few fronts. A body takes no
// more rows than it has degrees of freedom, since further rows would find no pivots there.
FrontalLu::Groups FrontalLu::find_groups(const List<Body>& bodies, const List<Link>& links) {
  const List<std::size_t> place = little_fill_order(bodies.size(), links);
  Groups groups;
  groups.own.resize(bodies.size());
  groups.couples.resize(bodies.size());
  List<int> room(bodies.size());
  const auto fill = [&](std::size_t group, int begin, int count) {
    for (int k = begin; k < begin + count; ++k) groups.own[group].push_back(to_index(k));
  };
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    fill(place[i], bodies[i].first, bodies[i].dofs);
    room[place[i]] = bodies[i].dofs;
  }
  struct Span {
    std::size_t first, last, link;
  };
  List<Span> spans;
  for (std::size_t l = 0; l < links.size(); ++l) {
    const std::size_t a = place[links[l].body];
    Span span{a, a, l};
    for (const int other : {links[l].other, links[l].more[0], links[l].more[1]}) {
      if (other < 0) continue;
      span.first = std::min(span.first, place[other]);
      span.last = std::max(span.last, place[other]);
    }
    spans.push_back(span);
  }
  // Rows that would be delayed most choose first.
  std::stable_sort(spans.begin(), spans.end(),
                   [](const Span& a, const Span& b) { return a.last > b.last; });
  List<std::size_t> group_of_link(links.size());
  for (const Span& span : spans) {
    const Link& link = links[span.link];
    const bool has_room = room[span.first] >= link.rows;
    const std::size_t group = has_room ? span.first : span.last;
    room[group] -= link.rows;
    fill(group, link.first, link.rows);
    group_of_link[span.link] = group;
  }
  std::size_t n = 0;
  for (const auto& own : groups.own) n += own.size();
  groups.group_of.resize(n);
  for (std::size_t g = 0; g < groups.own.size(); ++g)
    for (const std::size_t u : groups.own[g]) groups.group_of[u] = g;
  for (const Span& span : spans) {
    const Link& link = links[span.link];
    const auto couple = [&](std::size_t group, int begin, int count) {
      for (int k = 0; k < count; ++k) groups.couples[group].push_back(to_index(begin + k));
    };
    const std::size_t of_rows = group_of_link[span.link];
    for (const int body : {link.body, link.other, link.more[0], link.more[1]}) {
      if (body < 0) continue;
      const std::size_t p = place[body];
      if (p < of_rows) couple(p, link.first, link.rows);
      if (p > of_rows) couple(of_rows, bodies[body].first, bodies[body].dofs);
    }
    if (link.other < 0) continue;
    const bool is_other_later = place[link.other] > place[link.body];
    const Body& later = bodies[is_other_later ? link.other : link.body];
    couple(place[is_other_later ? link.body : link.other], later.first, later.dofs);
  }
  return groups;
}

// Finds the border of each group: the unknowns that its own unknowns couple with, and the remaining
// borders of its children.
void FrontalLu::find_borders(Groups* groups) {
  const std::size_t n = groups->own.size();
  const auto& group_of = groups->group_of;
  groups->border = groups->couples;
  groups->parent.resize(n);
  for (std::size_t g = 0; g < n; ++g) {
    auto& border = groups->border[g];
    std::sort(border.begin(), border.end(), [&](std::size_t i, std::size_t j) {
      return std::make_pair(group_of[i], i) < std::make_pair(group_of[j], j);
    });
    border.erase(std::unique(border.begin(), border.end()), border.end());
    groups->parent[g] = border.empty() ? g : group_of[border.front()];
    if (border.empty()) continue;
    auto& above = groups->border[groups->parent[g]];
    for (const std::size_t u : border)
      if (group_of[u] != groups->parent[g]) above.push_back(u);
  }
}

// Joins a group to its parent where few of the joint entries are zero.
void FrontalLu::join(Groups* groups) {
  const std::size_t n = groups->own.size();
  groups->is_joined.assign(n, 0);
  List<List<std::size_t>> children(n);
  const auto entries = [](std::size_t own, std::size_t border) { return own * (own + 2 * border); };
  for (std::size_t g = 0; g < n; ++g)
    if (groups->parent[g] != g) children[groups->parent[g]].push_back(g);
  List<std::size_t> needed(n);  // number of entries without joining
  for (std::size_t g = 0; g < n; ++g) {
    auto& own = groups->own[g];
    const std::size_t border = groups->border[g].size();
    needed[g] = entries(own.size(), border);
    for (std::size_t k = children[g].size(); k-- > 0;) {
      const std::size_t child = children[g][k];
      const std::size_t apart = needed[g] + needed[child];
      const std::size_t together = entries(own.size() + groups->own[child].size(), border);
      if (static_cast<double>(together) >
          (1.0 + kInVain) * static_cast<double>(apart) + static_cast<double>(kFewInVain))
        continue;
      groups->is_joined[child] = 1;
      needed[g] = apart;
      own.insert(own.end(), groups->own[child].begin(), groups->own[child].end());
    }
  }
  // Updates parents and groups of unknowns after joining.
  for (std::size_t g = n; g-- > 0;) {
    std::size_t& parent = groups->parent[g];
    if (groups->is_joined[parent]) parent = groups->parent[parent];
  }
  for (std::size_t g = 0; g < n; ++g)
    if (!groups->is_joined[g])
      for (const std::size_t u : groups->own[g]) groups->group_of[u] = g;
}

void FrontalLu::make_fronts(const Groups& groups) {
  List<List<std::size_t>> children(groups.own.size());
  List<std::size_t> pending, order;
  for (std::size_t g = groups.own.size(); g-- > 0;) {
    if (groups.is_joined[g]) continue;
    if (groups.parent[g] != g)
      children[groups.parent[g]].push_back(g);
    else
      pending.push_back(g);
  }
  while (!pending.empty()) {
    order.push_back(pending.back());
    pending.pop_back();
    const auto& more = children[order.back()];
    pending.insert(pending.end(), more.begin(), more.end());
  }

  fronts_.clear();
  unknown_.clear();
  child_.clear();
  place_.clear();
  entry_.clear();
  List<std::size_t> front_of(groups.own.size()), place(n_);
  for (std::size_t k = order.size(); k-- > 0;) {  // children before parents
    const std::size_t g = order[k];
    front_of[g] = fronts_.size();
    List<std::size_t> of_front;
    for (const std::size_t child : children[g]) of_front.push_back(front_of[child]);
    std::sort(of_front.begin(), of_front.end());  // order of their blocks on the stack
    add_front(groups, g, of_front, &place);
  }
  factors_.assign(fronts_.size(), Factor{});
}

// Appends the front of a group; `place` is scratch for the places of unknowns in the front.
void FrontalLu::add_front(const Groups& groups, std::size_t g, const List<std::size_t>& children,
                          List<std::size_t>* place) {
  Front front;
  front.own = groups.own[g].size();
  front.border = groups.border[g].size();
  front.unknowns = unknown_.size();
  front.is_root = groups.parent[g] == g;
  unknown_.insert(unknown_.end(), groups.own[g].begin(), groups.own[g].end());
  unknown_.insert(unknown_.end(), groups.border[g].begin(), groups.border[g].end());
  const std::size_t* const unknowns = unknown_.data() + front.unknowns;
  for (std::size_t k = 0; k < front.own + front.border; ++k) (*place)[unknowns[k]] = k;

  for (const std::size_t child : children) {
    Front& of_child = fronts_[child];
    of_child.place_in_parent = place_.size();
    const std::size_t* const border = unknown_.data() + of_child.unknowns + of_child.own;
    for (std::size_t k = 0; k < of_child.border; ++k) place_.push_back((*place)[border[k]]);
  }
  child_.insert(child_.end(), children.begin(), children.end());
  front.children_end = child_.size();

  // Entries with an own unknown and no unknown eliminated earlier.
  for (std::size_t i = 0; i < front.own + front.border; ++i) {
    const bool is_own = i < front.own;
    for (std::size_t s = row_begin_[unknowns[i]]; s < row_begin_[unknowns[i] + 1]; ++s) {
      const std::size_t of_column = groups.group_of[column_[s]];
      if (is_own ? of_column >= g : of_column == g) entry_.push_back({s, i, (*place)[column_[s]]});
    }
  }
  front.entries_end = entry_.size();
  fronts_.push_back(front);
}

std::size_t FrontalLu::slot(int row, int column) const {
  const auto begin = column_.begin() + static_cast<std::ptrdiff_t>(row_begin_[row]);
  const auto end = column_.begin() + static_cast<std::ptrdiff_t>(row_begin_[to_index(row) + 1]);
  return static_cast<std::size_t>(std::lower_bound(begin, end, to_index(column)) - column_.begin());
}

}  // namespace constraint_sim::engine
