#include "engine/linear/frontal_lu.h"

#include <Eigen/OrderingMethods>
#include <Eigen/SparseCore>
#include <algorithm>
#include <cmath>

#include "engine/linear/dense_front.h"

namespace constraint_sim::engine {
namespace {

// Zero entries that a front may have where it takes in its children: a share, and so many.
constexpr double kInVain = 0.1;
constexpr std::size_t kFewInVain = 100;

// Residual, as a share of what it is the difference of, that ends a refinement, and what each step
// of it must gain at least. With new factors a solution is taken as it is below the third.
constexpr double kRefined = 1e-10;
constexpr double kGain = 0.3;
constexpr int kMostRefinements = 10;
constexpr double kSolved = 1e-8;
// What an entry costs in a refinement, where it is read from far, in operations of a factorisation.
constexpr double kMemory = 4.0;

std::size_t at(int i) { return static_cast<std::size_t>(i); }

// place of each body in an elimination with little fill
std::vector<std::size_t> little_fill_order(std::size_t n,
                                           const std::vector<FrontalLu::Link>& links) {
  std::vector<Eigen::Triplet<double>> triplets;
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
  std::vector<std::size_t> order(n);
  for (std::size_t k = 0; k < n; ++k)
    order[at(permutation.indices()[static_cast<Eigen::Index>(k)])] = k;
  return order;
}

void sort_unique(std::vector<std::size_t>* list) {
  std::sort(list->begin(), list->end());
  list->erase(std::unique(list->begin(), list->end()), list->end());
}

// with some to spare, since what is delayed varies
template <class Number>
void make_room(std::vector<Number>* list, std::size_t size) {
  if (list->size() < size) list->resize(size + size / 4);
}

// ---- parts of a substitution

// Takes a x off y: rows × columns. Four sums at a time do not wait for each other.
void subtract_products(const double* a, std::size_t stride, std::size_t rows, std::size_t columns,
                       const double* x, double* y) {
  std::size_t i = 0;
  for (; i + 4 <= rows; i += 4) {
    const double* const row = a + i * stride;
    double p = y[i], q = y[i + 1], r = y[i + 2], s = y[i + 3];
    for (std::size_t k = 0; k < columns; ++k) {
      p -= row[k] * x[k];
      q -= row[stride + k] * x[k];
      r -= row[2 * stride + k] * x[k];
      s -= row[3 * stride + k] * x[k];
    }
    y[i] = p;
    y[i + 1] = q;
    y[i + 2] = r;
    y[i + 3] = s;
  }
  for (; i < rows; ++i)
    for (std::size_t k = 0; k < columns; ++k) y[i] -= a[i * stride + k] * x[k];
}

// x = l⁻¹ x, l of size n with a unit diagonal
void subtract_triangle(const double* l, std::size_t stride, std::size_t n, double* x) {
  for (std::size_t k = 0; k < n; k += 4) {
    const std::size_t end = std::min(k + 4, n);
    subtract_products(l + k * stride, stride, end - k, k, x, x + k);
    for (std::size_t i = k + 1; i < end; ++i)
      for (std::size_t j = k; j < i; ++j) x[i] -= l[i * stride + j] * x[j];
  }
}

}  // namespace

// ---- what is compiled

// Bodies with the rows that go with them, in the order of the elimination.
struct FrontalLu::Groups {
  std::vector<std::vector<std::size_t>> own, border;  // unknowns
  std::vector<std::vector<std::size_t>> couples;      // with unknowns of later groups
  std::vector<std::size_t> group_of;                  // of unknowns
  std::vector<std::size_t> parent;                    // or itself, of a root
  std::vector<char> is_joined;                        // to its parent
};

void FrontalLu::analyze(const std::vector<Body>& bodies, const std::vector<Link>& links) {
  n_ = 0;
  for (const Body& body : bodies) n_ += at(body.dofs);
  for (const Link& link : links) n_ += at(link.rows);
  find_pattern(bodies, links);
  Groups groups = find_groups(bodies, links);
  find_borders(&groups);
  join(&groups);
  make_fronts(groups);
  for (auto* list : {&solution_, &residual_, &change_}) list->assign(n_, 0.0);
  has_factors_ = false;
}

void FrontalLu::find_pattern(const std::vector<Body>& bodies, const std::vector<Link>& links) {
  std::vector<std::vector<std::size_t>> columns(n_);
  const auto couple = [&](int first, int count, int other, int others) {
    for (int i = first; i < first + count; ++i)
      for (int j = other; j < other + others; ++j) {
        columns[at(i)].push_back(at(j));
        columns[at(j)].push_back(at(i));
      }
  };
  for (const Body& body : bodies) couple(body.first, body.dofs, body.first, body.dofs);
  for (const Link& link : links) {
    const Body& body = bodies[at(link.body)];
    couple(link.first, link.rows, link.first, link.rows);
    couple(link.first, link.rows, body.first, body.dofs);
    for (const int further : link.more)
      if (further >= 0)
        couple(link.first, link.rows, bodies[at(further)].first, bodies[at(further)].dofs);
    if (link.other < 0) continue;
    const Body& other = bodies[at(link.other)];
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

// Rows go with the first of their bodies, so that they are in as few fronts as may be; but no more
// of them than it has freedoms, since those would have no pivots there.
FrontalLu::Groups FrontalLu::find_groups(const std::vector<Body>& bodies,
                                         const std::vector<Link>& links) {
  const std::vector<std::size_t> place = little_fill_order(bodies.size(), links);
  Groups groups;
  groups.own.resize(bodies.size());
  groups.couples.resize(bodies.size());
  std::vector<int> room(bodies.size());
  const auto fill = [&](std::size_t group, int begin, int count) {
    for (int k = begin; k < begin + count; ++k) groups.own[group].push_back(at(k));
  };
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    fill(place[i], bodies[i].first, bodies[i].dofs);
    room[place[i]] = bodies[i].dofs;
  }
  struct Span {
    std::size_t first, last, link;
  };
  std::vector<Span> spans;
  for (std::size_t l = 0; l < links.size(); ++l) {
    const std::size_t a = place[at(links[l].body)];
    Span span{a, a, l};
    for (const int other : {links[l].other, links[l].more[0], links[l].more[1]}) {
      if (other < 0) continue;
      span.first = std::min(span.first, place[at(other)]);
      span.last = std::max(span.last, place[at(other)]);
    }
    spans.push_back(span);
  }
  // rows whose elimination would be delayed most have the first choice
  std::stable_sort(spans.begin(), spans.end(),
                   [](const Span& a, const Span& b) { return a.last > b.last; });
  std::vector<std::size_t> group_of_link(links.size());
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
      for (int k = 0; k < count; ++k) groups.couples[group].push_back(at(begin + k));
    };
    const std::size_t of_rows = group_of_link[span.link];
    for (const int body : {link.body, link.other, link.more[0], link.more[1]}) {
      if (body < 0) continue;
      const std::size_t p = place[at(body)];
      if (p < of_rows) couple(p, link.first, link.rows);
      if (p > of_rows) couple(of_rows, bodies[at(body)].first, bodies[at(body)].dofs);
    }
    if (link.other < 0) continue;
    const bool is_other_later = place[at(link.other)] > place[at(link.body)];
    const Body& later = bodies[at(is_other_later ? link.other : link.body)];
    couple(place[at(is_other_later ? link.body : link.other)], later.first, later.dofs);
  }
  return groups;
}

// of each group what its own unknowns couple with, and what its children leave
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

// A group joins its parent where few of the entries then kept are zero.
void FrontalLu::join(Groups* groups) {
  const std::size_t n = groups->own.size();
  groups->is_joined.assign(n, 0);
  std::vector<std::vector<std::size_t>> children(n);
  const auto entries = [](std::size_t own, std::size_t border) { return own * (own + 2 * border); };
  for (std::size_t g = 0; g < n; ++g)
    if (groups->parent[g] != g) children[groups->parent[g]].push_back(g);
  std::vector<std::size_t> needed(n);  // entries without joining
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
  // what now is whose
  for (std::size_t g = n; g-- > 0;) {
    std::size_t& parent = groups->parent[g];
    if (groups->is_joined[parent]) parent = groups->parent[parent];
  }
  for (std::size_t g = 0; g < n; ++g)
    if (!groups->is_joined[g])
      for (const std::size_t u : groups->own[g]) groups->group_of[u] = g;
}

void FrontalLu::make_fronts(const Groups& groups) {
  std::vector<std::vector<std::size_t>> children(groups.own.size());
  std::vector<std::size_t> pending, order;
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
  std::vector<std::size_t> front_of(groups.own.size()), place(n_);
  for (std::size_t k = order.size(); k-- > 0;) {  // children before parents
    const std::size_t g = order[k];
    front_of[g] = fronts_.size();
    std::vector<std::size_t> of_front;
    for (const std::size_t child : children[g]) of_front.push_back(front_of[child]);
    std::sort(of_front.begin(), of_front.end());  // as what they leave is on the stack
    add_front(groups, g, of_front, &place);
  }
  factors_.assign(fronts_.size(), Factor{});
}

// `place`: room for where unknowns are in the front.
void FrontalLu::add_front(const Groups& groups, std::size_t g,
                          const std::vector<std::size_t>& children,
                          std::vector<std::size_t>* place) {
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

  // entries with an own unknown and none that is eliminated before
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
  const auto begin = column_.begin() + static_cast<std::ptrdiff_t>(row_begin_[at(row)]);
  const auto end = column_.begin() + static_cast<std::ptrdiff_t>(row_begin_[at(row) + 1]);
  return static_cast<std::size_t>(std::lower_bound(begin, end, at(column)) - column_.begin());
}

// ---- numbers

bool FrontalLu::factor(const double* values) {
  factor_end_ = stack_end_ = index_end_ = 0;
  std::size_t longest = 0;
  double operations = 0.0, entries = static_cast<double>(column_.size());
  for (std::size_t f = 0; f < fronts_.size(); ++f) {
    assemble(f, values);
    const Front& front = fronts_[f];
    Factor& factor = factors_[f];
    std::size_t* const rows = index_.data() + factor.indices;
    const std::size_t summed = factor.size - front.border;
    factor.pivots =
        DenseFront(factor_.data() + factor.values, factor.size, summed, rows, rows + factor.size)
            .eliminate();
    factor.delayed = summed - factor.pivots;
    if (front.is_root && factor.delayed > 0) return false;
    store(f);
    longest = std::max(longest, factor.size);
    const auto size = static_cast<double>(factor.size), n = static_cast<double>(factor.pivots);
    operations += n * (size * (size - n) + n * n / 3.0);
    entries += n * (2.0 * size - n);
  }
  make_room(&front_, longest);
  const double refinements = operations / (kMemory * entries);
  worthwhile_ = static_cast<int>(std::min(refinements, 1.0 * kMostRefinements));
  return true;
}

// The front's matrix, at the end of factor_: what A has of it, and what its children leave.
void FrontalLu::assemble(std::size_t f, const double* values) {
  const Front& front = fronts_[f];
  Factor& factor = factors_[f];
  const std::size_t children = f > 0 ? fronts_[f - 1].children_end : 0;
  std::size_t delayed = 0;
  for (std::size_t c = children; c < front.children_end; ++c)
    delayed += factors_[child_[c]].delayed;
  factor.size = delayed + front.own + front.border;
  factor.values = factor_end_;
  factor.indices = index_end_;
  const std::size_t end = factor_end_ + factor.size * factor.size;
  make_room(&factor_, end);
  make_room(&index_, index_end_ + 2 * factor.size);
  double* const a = factor_.data() + factor.values;
  std::fill_n(a, factor.size * factor.size, 0.0);
  std::size_t* const rows = index_.data() + factor.indices;
  for (std::size_t k = 0; k < front.own + front.border; ++k)
    rows[delayed + k] = rows[factor.size + delayed + k] = unknown_[front.unknowns + k];

  const std::size_t corner = delayed * (factor.size + 1);
  for (std::size_t e = f > 0 ? fronts_[f - 1].entries_end : 0; e < front.entries_end; ++e)
    a[corner + entry_[e].row * factor.size + entry_[e].column] += values[entry_[e].slot];
  std::size_t delayed_at = 0;
  for (std::size_t c = children; c < front.children_end; ++c) {
    add_child(child_[c], delayed_at, delayed, &factor);
    delayed_at += factors_[child_[c]].delayed;
  }
  if (children < front.children_end) stack_end_ = factors_[child_[children]].block;
}

void FrontalLu::add_child(std::size_t child, std::size_t delayed_at, std::size_t delayed,
                          Factor* to) {
  const Factor& from = factors_[child];
  const std::size_t left = from.size - from.pivots;
  const std::size_t* const place = place_.data() + fronts_[child].place_in_parent;
  const auto place_of = [&](std::size_t k) {
    return k < from.delayed ? delayed_at + k : delayed + place[k - from.delayed];
  };
  std::size_t* const rows = index_.data() + to->indices;
  const std::size_t* const of_child = index_.data() + from.indices + from.pivots;
  for (std::size_t k = 0; k < from.delayed; ++k) {
    rows[delayed_at + k] = of_child[k];
    rows[to->size + delayed_at + k] = of_child[from.size + k];
  }
  for (std::size_t i = 0; i < left; ++i) {
    const double* const row = stack_.data() + from.block + i * left;
    double* const target = factor_.data() + to->values + place_of(i) * to->size;
    for (std::size_t j = 0; j < from.delayed; ++j) target[delayed_at + j] += row[j];
    for (std::size_t j = from.delayed; j < left; ++j)
      target[delayed + place[j - from.delayed]] += row[j];
  }
}

// Keeps U and L one after the other, and puts what is left on the stack.
void FrontalLu::store(std::size_t f) {
  Factor& factor = factors_[f];
  const std::size_t left = factor.size - factor.pivots;
  double* const a = factor_.data() + factor.values;
  factor.block = stack_end_;
  stack_end_ += left * left;
  make_room(&stack_, stack_end_);
  double* L = a + factor.pivots * factor.size;
  for (std::size_t i = 0; i < left; ++i) {
    const double* const row = a + (factor.pivots + i) * factor.size;
    std::copy(row + factor.pivots, row + factor.size, stack_.data() + factor.block + i * left);
    L = std::copy(row, row + factor.pivots, L);
  }
  factor_end_ = static_cast<std::size_t>(L - factor_.data());
  index_end_ += 2 * factor.size;
}

// Each front has what it needs of b, and of x, side by side in front_.
void FrontalLu::substitute(double* b, double* x) {
  double* const local = front_.data();
  for (const Factor& factor : factors_) {
    const std::size_t n = factor.pivots, size = factor.size;
    const double* const U = factor_.data() + factor.values;
    const std::size_t* const rows = index_.data() + factor.indices;
    for (std::size_t i = 0; i < size; ++i) local[i] = b[rows[i]];
    subtract_triangle(U, size, n, local);
    subtract_products(U + n * size, n, size - n, n, local, local + n);
    for (std::size_t i = 0; i < size; ++i) b[rows[i]] = local[i];
  }
  for (std::size_t f = factors_.size(); f-- > 0;) {
    const Factor& factor = factors_[f];
    const std::size_t n = factor.pivots, size = factor.size;
    const double* const U = factor_.data() + factor.values;
    const std::size_t* const rows = index_.data() + factor.indices;
    const std::size_t* const columns = rows + size;
    for (std::size_t i = 0; i < n; ++i) local[i] = b[rows[i]];
    for (std::size_t i = n; i < size; ++i) local[i] = x[columns[i]];
    subtract_products(U + n, size, n, size - n, local + n, local);
    for (std::size_t i = n; i-- > 0;) {
      double sum = local[i];
      for (std::size_t k = i + 1; k < n; ++k) sum -= U[i * size + k] * local[k];
      x[columns[i]] = local[i] = sum / U[i * size + i];
    }
  }
}

double FrontalLu::residual(const double* values, const double* b, const double* x) {
  double largest = 0.0, most = 0.0;
  for (std::size_t i = 0; i < n_; ++i) {
    double sum = b[i], size = std::abs(b[i]);
    for (std::size_t s = row_begin_[i]; s < row_begin_[i + 1]; ++s) {
      const double term = values[s] * x[column_[s]];
      sum -= term;
      size += std::abs(term);
    }
    residual_[i] = sum;
    if (!(std::abs(sum) <= largest)) largest = std::abs(sum);
    most = std::max(most, size);
  }
  return most > 0.0 ? largest / most : 0.0;
}

// The solution to solution_, refined until its residual is small; false where it stays above
// `enough`.
bool FrontalLu::refine(const double* values, const double* b, int steps, double enough) {
  std::fill(solution_.begin(), solution_.end(), 0.0);
  std::copy(b, b + n_, residual_.begin());
  double before = 1.0;
  for (int k = 1; k <= steps; ++k) {
    substitute(residual_.data(), change_.data());
    for (std::size_t i = 0; i < n_; ++i) solution_[i] += change_[i];
    const double share = residual(values, b, solution_.data());
    if (share <= kRefined) return true;
    const double left = std::log(kRefined / share) / std::log(share / before);  // at this rate
    if (!(share <= kGain * before && k + left <= steps)) return share <= enough;
    before = share;
  }
  return before <= enough;
}

bool FrontalLu::solve(const double* values, double* b) {
  bool done = has_factors_ && worthwhile_ > 0 && refine(values, b, worthwhile_, 0.0);
  if (!done) {
    has_factors_ = factor(values);
    done = has_factors_ && refine(values, b, kMostRefinements, kSolved);
  }
  if (done) std::copy(solution_.begin(), solution_.end(), b);
  return done;
}

}  // namespace constraint_sim::engine
