#include "engine/dynamics/island_model.h"

#include <algorithm>
#include <array>
#include <iterator>
#include <unordered_map>

#include "engine/math/list.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

}  // namespace

IslandModel::IslandModel(List<int> joints, const List<Joint>& all_joints, const Ends& ends,
                         const List<MassProperties>& masses, const List<CoupledTerms>& couplings,
                         const List<int>& idle, const List<char>& open)
    : joints_(std::move(joints)) {
  find_bodies(all_joints, ends, masses, idle, open);
  const bool is_in_line = open.empty() && order_as_chain(all_joints, ends, masses);
  is_chain_ = is_in_line && rotating_ == 0;
  is_chain_of_bodies_ = is_in_line && rotating_ > 0;
  for (const int body : bodies_) inverse_mass_.push_back(masses[body].inverse_mass);
  for (std::size_t i = 0; i < rotating_; ++i) {
    inertia_.push_back(masses[bodies_[i]].inertia);
    radius_of_gyration_.push_back(masses[bodies_[i]].radius_of_gyration());
  }
  Places places;
  for (std::size_t i = 0; i < bodies_.size(); ++i) places[bodies_[i]] = i;
  sort_joints(all_joints, ends, places, open);
  add_links(all_joints, ends, masses, places);
  if (is_chain_) turn_along_chain();
  add_all_rows();
  add_coupled_rows(all_joints, couplings);
  const auto even = [](std::size_t n) { return n + n % 2; };
  layout_.v_at = even(3 * bodies_.size());
  layout_.q_at = 2 * layout_.v_at;
  layout_.L_at = layout_.q_at + 4 * rotating_;
  layout_.size = even(layout_.L_at + 3 * rotating_);
}

// Lists the bodies; bodies that rotate come first.
void IslandModel::find_bodies(const List<Joint>& all_joints, const Ends& ends,
                              const List<MassProperties>& masses, const List<int>& idle,
                              const List<char>& open) {
  List<int> turning, others;
  const auto add = [&](std::size_t body, const Vector3d& anchor, bool has_axes) {
    if (!masses[body].is_movable()) return;
    const bool turns = (!anchor.isZero(0.0) || has_axes) && masses[body].can_turn();
    (turns ? turning : others).push_back(static_cast<int>(body));
  };
  for (const List<int>* list : {static_cast<const List<int>*>(&joints_), &idle}) {
    for (const int j : *list) {
      const Joint& joint = all_joints[j];
      add(ends[j].first, joint.anchor_a, info(joint.kind).has_frames);
      const bool is_open = !open.empty() && open[j] != 0;
      add(ends[j].second, joint.anchor_b, is_open || turns_b(forms(joint.kind)));
    }
  }
  const auto sort_out = [](List<int>& list) {
    std::sort(list.begin(), list.end());
    list.erase(std::unique(list.begin(), list.end()), list.end());
  };
  sort_out(turning);
  sort_out(others);
  bodies_ = turning;
  rotating_ = turning.size();
  std::set_difference(others.begin(), others.end(), turning.begin(), turning.end(),
                      std::back_inserter(bodies_));
}

// Sorts joints and bodies in chain order where they form a chain: rods between centres, or ball
// joints between bodies that all rotate. Returns false for other islands.
bool IslandModel::order_as_chain(const List<Joint>& all_joints, const Ends& ends,
                                 const List<MassProperties>& masses) {
  const bool is_of_bodies = rotating_ > 0;
  if (is_of_bodies && rotating_ < bodies_.size()) return false;
  const auto place = [&](std::size_t body) {  // bodies_ is still sorted here
    const auto found = std::lower_bound(bodies_.begin(), bodies_.end(), static_cast<int>(body));
    return static_cast<std::size_t>(found - bodies_.begin());
  };
  List<std::array<int, 2>> rods_of(bodies_.size(), {-1, -1});  // rods or ball joints per body
  for (const int j : joints_) {
    const Joint& joint = all_joints[j];
    if (has_length(joint.kind) == is_of_bodies) return false;
    if (forms(joint.kind).form == RowsForm::kGeneral) return false;
    if (!length_spring(joint).is_none()) return false;
    for (const std::size_t body : {ends[j].first, ends[j].second}) {
      if (!masses[body].is_movable()) continue;
      auto& [first, second] = rods_of[place(body)];
      if (second >= 0) return false;
      (first < 0 ? first : second) = j;
    }
  }

  const auto is_end = [&](std::size_t body) {
    return !masses[body].is_movable() || rods_of[place(body)][1] < 0;
  };
  const auto first = std::find_if(joints_.begin(), joints_.end(), [&](int j) {
    return is_end(ends[j].first) || is_end(ends[j].second);
  });
  if (first == joints_.end()) return false;  // closed ring
  int rod = *first;
  std::size_t body = is_end(ends[rod].first) ? ends[rod].first : ends[rod].second;
  List<int> rods, bodies;
  if (masses[body].is_movable()) bodies.push_back(static_cast<int>(body));
  while (rod >= 0) {
    rods.push_back(rod);
    const auto& [a, b] = ends[rod];
    body = body == a ? b : a;
    if (!masses[body].is_movable()) break;
    bodies.push_back(static_cast<int>(body));
    const auto& both = rods_of[place(body)];
    rod = both[0] == rod ? both[1] : both[0];
  }
  if (bodies.size() < bodies_.size()) return false;  // some bodies are on no rod
  joints_ = rods;
  bodies_ = bodies;
  return true;
}

// Directs all links from one point of the chain to the next; swapping A and B has no effect here.
void IslandModel::turn_along_chain() {
  for (std::size_t l = 0; l + 1 < links_.size(); ++l) {
    const Link& next = links_[l + 1];
    Link& link = links_[l];
    if (link.a == next.a || link.a == next.b) std::swap(link.a, link.b);
  }
  if (links_.size() < 2) return;
  Link& last = links_.back();
  if (last.a != links_[links_.size() - 2].b) std::swap(last.a, last.b);
}

// Sorts joints: rods between centres, other rods, ball joints, general joints, springs.
void IslandModel::sort_joints(const List<Joint>& all_joints, const Ends& ends, const Places& places,
                              const List<char>& open) {
  const auto turns_body = [&](std::size_t body) {
    const auto found = places.find(body);
    return found != places.end() && rotates(found->second);
  };
  const auto place_in_order = [&](int j) {
    const Joint& joint = all_joints[j];
    if (!has_length(joint.kind)) {
      const bool is_open = !open.empty() && open[j] != 0;
      return is_open || forms(joint.kind).form == RowsForm::kGeneral ? 3 : 2;
    }
    if (!length_spring(joint).is_none()) return 4;
    return turns_body(ends[j].first) || turns_body(ends[j].second) ? 1 : 0;
  };
  std::stable_sort(joints_.begin(), joints_.end(),
                   [&](int i, int j) { return place_in_order(i) < place_in_order(j); });
  const auto count_below = [&](int most) {
    return static_cast<std::size_t>(std::count_if(joints_.begin(), joints_.end(),
                                                  [&](int j) { return place_in_order(j) < most; }));
  };
  first_.armed = count_below(1);
  first_.ball = count_below(2);
  first_.general = count_below(3);
  first_.spring = count_below(4);
}

void IslandModel::add_links(const List<Joint>& all_joints, const Ends& ends,
                            const List<MassProperties>& masses, const Places& places) {
  const auto point_of = [&](std::size_t body, const Vector3d& anchor, bool has_axes) {
    if (masses[body].is_movable()) return places.at(body);
    fixed_points_.push_back({static_cast<int>(body), anchor, has_axes});
    inverse_mass_.push_back(0.0);
    return inverse_mass_.size() - 1;
  };
  for (const int j : joints_) {
    const Joint& joint = all_joints[j];
    Link link{};
    const bool has_axes = info(joint.kind).has_frames;
    link.a = point_of(ends[j].first, joint.anchor_a, has_axes);
    link.b = point_of(ends[j].second, joint.anchor_b, has_axes);
    link.kind = joint.kind;
    link.anchor_a = joint.anchor_a;
    link.anchor_b = joint.anchor_b;
    link.has_arms = rotates(link.a) || rotates(link.b);
    const SoftLaw spring = length_spring(joint);
    link.stiffness = spring.K;
    link.damping = spring.C;
    if (has_axes) {
      link.frame_a = joint.frame_a.toRotationMatrix();
      link.frame_b = joint.frame_b->toRotationMatrix();
      for (const std::size_t body : {ends[j].first, ends[j].second})
        link.radius = std::max(link.radius, masses[body].radius_of_gyration());
    }
    link.custom = joint.custom.code.get();
    has_custom_forces_ = has_custom_forces_ || link.has_custom_force();
    add_coordinates(joint, links_.size(), &link, &softs_);
    links_.push_back(link);
  }
}

// Adds the motors and soft coordinates of a joint to link l.
void IslandModel::add_coordinates(const Joint& joint, std::size_t l, Link* link,
                                  List<SoftCoordinate>* softs) {
  const JointForms& kind = forms(joint.kind);
  link->rows = kind.rows;
  link->first_soft = softs->size();
  for (int i = 0; i < kind.coordinates; ++i) {
    const CoordinateLaw& law = joint.coordinates[i];
    const SoftLaw soft = soft_law(law);
    if (is_held(law))
      link->function[link->rows++] = static_cast<std::uint8_t>(kind.rows + i);
    else if (!soft.is_none())
      softs->push_back({l, kind.rows + i, kind.coordinate[i], soft, law.zero});
  }
  link->softs = softs->size() - link->first_soft;
}

bool IslandModel::follow_laws(const List<Joint>& all_joints) {
  List<SoftCoordinate> softs;
  List<Link> links = links_;
  for (std::size_t l = 0; l < links.size(); ++l) {
    const Joint& joint = all_joints[joints_[l]];
    const SoftLaw spring = length_spring(joint);
    if (has_length(joint.kind) && spring.is_none() != is_rod(l)) return false;
    links[l].stiffness = spring.K;
    links[l].damping = spring.C;
    add_coordinates(joint, l, &links[l], &softs);
    if (links[l].rows != links_[l].rows || links[l].softs != links_[l].softs) return false;
    const auto end = links[l].function.begin() + links[l].rows;
    if (!std::equal(links[l].function.begin(), end, links_[l].function.begin())) return false;
  }
  const auto is_at_same = [](const SoftCoordinate& a, const SoftCoordinate& b) {
    return a.function == b.function && a.zero == b.zero;
  };
  if (!std::equal(softs.begin(), softs.end(), softs_.begin(), is_at_same)) return false;
  for (const CoupledRow& coupled : coupled_)
    for (const CoupledRow::Term& term : coupled.terms)
      if (term.zero != all_joints[joints_[term.link]].coordinates[to_index(term.coordinate)].zero)
        return false;
  links_ = std::move(links);
  softs_ = std::move(softs);
  return true;
}

void IslandModel::add_all_rows() {
  for (std::size_t l = 0; l < first_.spring; ++l) {
    Link& link = links_[l];
    link.first_row = rows_.size();
    const std::size_t count = is_rod(l) ? 1 : is_ball(l) ? 3 : rows_of(l);
    for (std::size_t k = 0; k < count; ++k) {
      if (is_general(l)) {
        const ScalarForm of_row = form(l, k);
        general_rows_.push_back(
            {rows_.size(), l, of_row, of_row.has_separation() ? 1.0 : link.radius});
      }
      rows_.push_back(new_row(link, rows_.size()));
    }
  }
}

IslandModel::Row IslandModel::new_row(const Link& link, std::size_t part) {
  Row row{};
  row.a = link.a;
  row.b = link.b;
  row.block_a = row.block_b = -1;
  row.inverse_mass = inverse_mass_[link.a] + inverse_mass_[link.b];
  const auto turn = [&](std::size_t point) {
    angular_blocks_.push_back({point, part});
    return static_cast<int>(angular_blocks_.size()) - 1;
  };
  if (rotates(link.a)) row.block_a = turn(link.a);
  if (rotates(link.b)) row.block_b = turn(link.b);
  return row;
}

// Adds each coupled row with its first part, then the second parts of all coupled rows.
void IslandModel::add_coupled_rows(const List<Joint>& all_joints,
                                   const List<CoupledTerms>& couplings) {
  const auto link_of = [&](std::size_t joint) {
    const auto found = std::find(joints_.begin(), joints_.end(), static_cast<int>(joint));
    return static_cast<std::size_t>(found - joints_.begin());
  };
  for (std::size_t l = first_.general; l < first_.spring; ++l) {
    if (!info(links_[l].kind).couples) continue;
    CoupledRow coupled{};
    coupled.link = l;
    for (std::size_t k = 0; k < 2; ++k) {
      const CoupledTerm& from = couplings[joints_[l]][k];
      const Joint& joint = all_joints[from.joint];
      const auto i = to_index(from.coordinate);
      CoupledRow::Term& term = coupled.terms[k];
      term.link = link_of(from.joint);
      term.coordinate = from.coordinate;
      term.form = forms(joint.kind).coordinate[i];
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
  }
  for (CoupledRow& coupled : coupled_) {
    coupled.terms[1].part = parts();
    parts_.push_back(new_row(links_[coupled.terms[1].link], parts()));
  }
}

}  // namespace constraint_sim::engine
