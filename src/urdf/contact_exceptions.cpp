#include "urdf/contact_exceptions.h"

#include <algorithm>
#include <map>
#include <set>
#include <stdexcept>
#include <utility>

#include "engine/collision/broadphase.h"
#include "engine/collision/narrowphase.h"
#include "engine/model/shape_properties.h"
#include "sim/words.h"
#include "urdf/xml_tags.h"

namespace constraint_sim {
namespace {

using IndexPair = std::pair<std::size_t, std::size_t>;

const std::string kNoContact = "no_contact/";
// Overlap of links that only touch: URDFs have lengths of six digits [m].
constexpr double kTouching = 1e-6;
// Exceptions of a robot; each costs time in each step.
constexpr std::size_t kMostPairs = 1000;
constexpr std::size_t kMostWarnings = 20;
constexpr std::size_t kMostListed = 200;  // characters of a list of links in a warning

double depth(const engine::Body& a, int part_a, const engine::Body& b, int part_b) {
  const engine::Manifold manifold = engine::collide(engine::PlacedShape(a, part_a, a.state),
                                                    engine::PlacedShape(b, part_b, b.state));
  double most = 0.0;
  for (int i = 0; i < manifold.count; ++i)
    most = std::max(most, manifold.points[static_cast<std::size_t>(i)].depth);
  return most;
}

class ExceptionSearch {
 public:
  ExceptionSearch(const Lumps& lumps, const std::vector<engine::Body>& bodies,
                  const std::vector<engine::Joint>& joints,
                  const std::map<std::string, std::size_t>& models)
      : lumps_(lumps), bodies_(bodies), models_(models) {
    for (const engine::Joint& joint : joints) {
      const bool is_pair = !engine::info(joint.kind).couples_joints && !joint.collide_connected;
      if (!is_pair || joint.body_a == engine::kWorldBody || joint.body_b == engine::kWorldBody)
        continue;
      joined_.insert(
          std::minmax(std::size_t{joint.body_a.value} - 1, std::size_t{joint.body_b.value} - 1));
    }
  }

  void add_neighbours() {
    std::map<std::size_t, std::vector<std::size_t>> members;
    for (std::size_t i = 0; i < bodies_.size(); ++i)
      if (collides(i)) members[group(i)].push_back(i);
    for (const auto& [i, j] : joined_) {
      if (group(i) == group(j)) continue;
      for (const std::size_t a : members[group(i)])
        for (const std::size_t b : members[group(j)]) except({a, b});
    }
  }

  // Excepts the pairs of bodies of which all pairs of links are listed.
  void add_listed(const std::vector<LinkPair>& listed) {
    std::map<std::string, std::vector<std::size_t>> by_link;
    for (std::size_t i = 0; i < lumps_.list.size(); ++i)
      for (const std::string& link : links_with_shapes(i)) by_link[link].push_back(i);
    std::map<IndexPair, std::set<LinkPair>> of_bodies;
    for (const auto& [first, second] : listed)
      for (const std::size_t i : by_link[first])
        for (const std::size_t j : by_link[second])
          if (i != j)
            of_bodies[std::minmax(i, j)].insert(i < j ? LinkPair{first, second}
                                                      : LinkPair{second, first});
    std::string partly;
    for (const auto& [pair, links] : of_bodies) {
      if (links.size() ==
          links_with_shapes(pair.first).size() * links_with_shapes(pair.second).size())
        except(pair);
      else if (!is_excepted(pair))
        for (const auto& [first, second] : links)
          partly += (partly.empty() ? "" : ", ") + ("'" + first + "' and '" + second + "'");
    }
    if (!partly.empty())
      warnings_.push_back(
          "pairs of links that are listed and collide nevertheless, since other links on the same "
          "bodies are not listed: " +
          engine::shortened(partly, kMostListed));
  }

  void add_overlaps() {
    engine::List<engine::Proxy> proxies;
    for (std::size_t i = 0; i < bodies_.size(); ++i) {
      if (!collides(i)) continue;
      const int parts = static_cast<int>(engine::part_count(bodies_[i].shape));
      for (int part = 0; part < parts; ++part) {
        const engine::PlacedShape placed(bodies_[i], part, bodies_[i].state);
        proxies.push_back({engine::bounds(placed.shape(), placed.state()), static_cast<int>(i),
                           true, static_cast<std::uint16_t>(part)});
      }
    }
    engine::Broadphase broadphase;
    std::size_t overlaps = 0;
    for (const engine::ShapePair& shapes : broadphase.find_pairs(proxies)) {
      const IndexPair pair{static_cast<std::size_t>(shapes.first),
                           static_cast<std::size_t>(shapes.second)};
      const std::string& first = link(pair.first, shapes.part_first);
      const std::string& second = link(pair.second, shapes.part_second);
      if (are_of_two_models(first, second) || is_excepted(pair)) continue;
      if (!(depth(bodies_[pair.first], shapes.part_first, bodies_[pair.second],
                  shapes.part_second) > kTouching))
        continue;
      except(pair);
      if (group(pair.first) == group(pair.second) || ++overlaps > kMostWarnings) continue;
      warnings_.push_back("links '" + first + "' and '" + second +
                          "' overlap, and do not collide with each other" + others_of(pair));
    }
    if (overlaps > kMostWarnings)
      warnings_.push_back("more links overlap than these " + std::to_string(kMostWarnings));
    if (broadphase.is_full()) left_out_ = true;
  }

  ContactExceptions take() {
    if (left_out_)
      warnings_.push_back("more than " + std::to_string(kMostPairs) +
                          " pairs of links are neighbours, overlap or are listed; the others "
                          "collide: no_collision of links ends that");
    return {{excepted_.begin(), excepted_.end()}, std::move(warnings_)};
  }

 private:
  const std::string& link(std::size_t i, int part) const {
    return lumps_.list[i].shapes[static_cast<std::size_t>(part)].link;
  }
  std::size_t group(std::size_t i) const { return lumps_.list[i].plane_of.value_or(i); }

  std::set<std::string> links_with_shapes(std::size_t i) const {
    std::set<std::string> links;
    for (const LumpShape& shape : lumps_.list[i].shapes) links.insert(shape.link);
    return links;
  }

  // Says which links an exception of two bodies concerns, where these have several.
  std::string others_of(const IndexPair& pair) const {
    std::string of[2];
    std::size_t count = 0;
    for (const std::size_t i : {pair.first, pair.second}) {
      const std::set<std::string> links = links_with_shapes(i);
      count += links.size();
      for (const std::string& link : links) {
        std::string& list = of[i == pair.second ? 1 : 0];
        list += (list.empty() ? "" : ", ") + link;
      }
    }
    if (count == 2) return "";
    return "; these are all links of two bodies, " + engine::shortened(of[0], kMostListed) +
           " and " + engine::shortened(of[1], kMostListed);
  }

  bool collides(std::size_t i) const {
    return !bodies_[i].no_collision && engine::has_surface(bodies_[i].shape);
  }

  bool are_of_two_models(const std::string& link, const std::string& other) const {
    const auto first = models_.find(link), second = models_.find(other);
    return first != models_.end() && second != models_.end() && first->second != second->second;
  }

  bool is_excepted(IndexPair pair) const {
    if (pair.first > pair.second) std::swap(pair.first, pair.second);
    return joined_.count(pair) > 0 || excepted_.count(pair) > 0;
  }

  void except(IndexPair pair) {
    const bool are_static = bodies_[pair.first].type == engine::BodyType::kStatic &&
                            bodies_[pair.second].type == engine::BodyType::kStatic;
    if (are_static || is_excepted(pair)) return;
    if (excepted_.size() < kMostPairs)
      excepted_.insert(std::minmax(pair.first, pair.second));
    else
      left_out_ = true;
  }

  const Lumps& lumps_;
  const std::vector<engine::Body>& bodies_;
  const std::map<std::string, std::size_t>& models_;
  std::set<IndexPair> joined_, excepted_;
  std::vector<std::string> warnings_;
  bool left_out_ = false;  // more pairs than kMostPairs
};

}  // namespace

ContactExceptions contact_exceptions(const Lumps& lumps, const std::vector<engine::Body>& bodies,
                                     const std::vector<engine::Joint>& joints,
                                     const std::vector<LinkPair>& listed,
                                     const std::map<std::string, std::size_t>& models) {
  ExceptionSearch search(lumps, bodies, joints, models);
  search.add_neighbours();
  search.add_listed(listed);
  search.add_overlaps();
  return search.take();
}

engine::Joint no_contact_joint(const std::string& prefix, const LinkPair& links, engine::BodyId a,
                               engine::BodyId b) {
  engine::Joint joint;
  joint.name = prefix + kNoContact + links.first + "/" + links.second;
  joint.kind = engine::JointKind::kFreeDistance;
  joint.body_a = a;
  joint.body_b = b;
  return joint;
}

bool is_contact_exception(const engine::Joint& joint) {
  return engine::info(joint.kind).is_free_length &&
         joint.name.find(kNoContact) != std::string::npos;
}

std::vector<LinkPair> disabled_collisions(const std::string& srdf) {
  std::vector<LinkPair> pairs;
  XmlTags tags(srdf);
  while (tags.next()) {
    if (tags.kind() == XmlTags::Kind::kDeclaration || tags.name() != "disable_collisions" ||
        tags.kind() == XmlTags::Kind::kEnd)
      continue;
    const LinkPair pair{tags.attribute("link1"), tags.attribute("link2")};
    if (pair.first.empty() || pair.second.empty())
      throw std::invalid_argument("srdf: <" + shortened(tags.text()) +
                                  "> needs the attributes link1 and link2");
    pairs.push_back(pair);
  }
  return pairs;
}

}  // namespace constraint_sim
