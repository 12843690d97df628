// Markers for rviz.

#include <gtest/gtest.h>
#include <ros/serialization.h>
#include <visualization_msgs/MarkerArray.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

#include "constraint_sim/engine/scene.h"
#include "counted_allocations.h"
#include "ros/labels.h"
#include "ros/markers.h"
#include "ros/parameters.h"
#include "ros/robots.h"
#include "ros/scenes.h"
#include "ros/view.h"
#include "test_paths.h"

namespace constraint_sim {
namespace {

using Eigen::Vector3d;
using visualization_msgs::Marker;
using visualization_msgs::MarkerArray;

constexpr double kRound = 0.02;  // simulated time of a round [s]

MarkerArray array_of(const MarkerMessage& message) {
  MarkerArray array;
  for (const Marker* marker : message.markers) array.markers.push_back(*marker);
  return array;
}

/// A subscriber with a round each kRound of simulated time.
class Listener {
 public:
  MarkerArray hear(const engine::World& world, bool is_newcomer = false, bool is_edited = false) {
    const ros::Time stamp(100.0 + world.time());
    forces.update(world, stamp);
    return array_of(markers_.update(world, forces, stamp, is_newcomer, is_edited));
  }
  const MarkerMessage& hear_only(const engine::World& world) {
    const ros::Time stamp(100.0 + world.time());
    forces.update(world, stamp);
    return markers_.update(world, forces, stamp, false, false);
  }
  ForceScale forces;

 private:
  Robots robots_{Parameters()};
  Markers markers_{"world", robots_};
};

void run(engine::World* world, double seconds) {
  const double end = world->time() + seconds - 1e-9;
  while (world->time() < end) world->step();
}

const Marker* find(const MarkerArray& array, const std::string& ns, std::int32_t id) {
  const auto found = std::find_if(array.markers.begin(), array.markers.end(),
                                  [&](const Marker& m) { return m.ns == ns && m.id == id; });
  return found != array.markers.end() ? &*found : nullptr;
}

engine::World kinds() {
  return engine::load_scene_file(std::string(CONSTRAINT_SIM_SOURCE_DIR) +
                                 "/docs/images/kinds.yaml");
}

std::vector<engine::World> scenes() {
  std::vector<engine::World> all{kinds()};
  for (const std::string& name : shipped_scenes())
    all.push_back(load_world(name, "", Parameters(), Caller::kParameter));
  return all;
}

void expect_same(const Marker& a, const Marker& b) {
  const std::string what = a.ns + " " + std::to_string(a.id);
  EXPECT_EQ(a.type, b.type) << what;
  EXPECT_EQ(a.action, b.action) << what;
  EXPECT_EQ(a.color, b.color) << what;
  EXPECT_EQ(a.scale, b.scale) << what;
  EXPECT_EQ(a.pose, b.pose) << what;
  EXPECT_EQ(a.colors, b.colors) << what;
  ASSERT_EQ(a.points.size(), b.points.size()) << what;
  for (std::size_t i = 0; i < a.points.size(); ++i) {
    // rounding of a hundred stretches
    EXPECT_NEAR(a.points[i].x, b.points[i].x, 1e-12) << what;
    EXPECT_NEAR(a.points[i].y, b.points[i].y, 1e-12) << what;
    EXPECT_NEAR(a.points[i].z, b.points[i].z, 1e-12) << what;
  }
}

// One subscriber receives every round, the other the first and the last: the first message
// determines the size of signs.
void expect_kept_is_anew(engine::World* world, int rounds) {
  Listener kept, anew;
  anew.hear(*world);
  for (int round = 0; round < rounds; ++round) {
    kept.hear(*world);
    run(world, kRound);
  }
  const MarkerArray ours = kept.hear(*world, true);
  anew.forces = kept.forces;  // forces of the last seconds, which it has not received
  const MarkerArray theirs = anew.hear(*world, true);
  std::size_t same = 0;
  for (const Marker& marker : ours.markers) {
    if (marker.action != Marker::ADD) continue;
    const Marker* other = find(theirs, marker.ns, marker.id);
    ASSERT_NE(other, nullptr) << marker.ns << " " << marker.id;
    expect_same(marker, *other);
    ++same;
  }
  EXPECT_GT(same, world->body_ids().size());
}

TEST(Markers, ThatWereKeptAreThoseDrawnAnew) {
  for (engine::World& world : scenes()) expect_kept_is_anew(&world, 100);
}

TEST(Markers, ThatWereStretchedAreThoseDrawnAnew) {
  engine::World world = engine::load_scene(
      "bodies: [{name: a, mass: 1, shape: {sphere: {radius: 0.1}}, position: [0, 0, -1]}]\n"
      "constraints: [{name: s, type: spring, body_b: a, frequency: 1, length: 1, damping_ratio: 0},"
      " {name: r, type: rope, body_b: a, anchor_a: [0.5, 0, 0], max_length: 1.3},"
      " {name: t, type: strut, body_b: a, anchor_a: [1, 0, -2], min_length: 0.2}]");
  for (const int rounds : {1, 10, 37, 300}) expect_kept_is_anew(&world, rounds);
}

void expect_on_the_wire_a_marker_array(const MarkerMessage& message) {
  const ros::SerializedMessage ours = ros::serialization::serializeMessage(message);
  const ros::SerializedMessage theirs = ros::serialization::serializeMessage(array_of(message));
  ASSERT_EQ(ours.num_bytes, theirs.num_bytes);
  EXPECT_EQ(std::memcmp(ours.buf.get(), theirs.buf.get(), ours.num_bytes), 0);
}

TEST(Markers, AreOnTheWireAMarkerArray) {
  for (engine::World& world : scenes()) {
    Listener listener;
    for (int round = 0; round < 10; ++round) {  // the first one is complete
      expect_on_the_wire_a_marker_array(listener.hear_only(world));
      run(&world, kRound);
    }
  }
  Marker marker;  // different values in all fields
  marker.header.seq = 1;
  marker.header.stamp = ros::Time(2, 3);
  marker.header.frame_id = "frame";
  marker.ns = "namespace";
  marker.id = 4;
  marker.type = 5;
  marker.action = 6;
  marker.pose.position.x = 7.0;
  marker.pose.position.y = 8.0;
  marker.pose.position.z = 9.0;
  marker.pose.orientation.x = 10.0;
  marker.pose.orientation.w = 11.0;
  marker.scale.x = 12.0;
  marker.scale.z = 13.0;
  marker.color.r = 14.0F;
  marker.color.a = 15.0F;
  marker.lifetime = ros::Duration(16, 17);
  marker.frame_locked = 1;
  marker.points.resize(2);
  marker.points[1].z = 18.0;
  marker.colors.resize(3);
  marker.colors[2].b = 19.0F;
  marker.text = "text";
  marker.mesh_resource = "package://mesh";
  marker.mesh_use_embedded_materials = 1;
  MarkerMessage message;
  message.markers = {&marker, &marker};
  expect_on_the_wire_a_marker_array(message);
  EXPECT_EQ(ros::message_traits::md5sum(message), ros::message_traits::md5sum<MarkerArray>());
  EXPECT_EQ(ros::message_traits::datatype(message), ros::message_traits::datatype<MarkerArray>());
}

std::ptrdiff_t broken_joints(const engine::World& world) {
  const auto ids = world.joint_ids();
  return std::count_if(ids.begin(), ids.end(),
                       [&](engine::JointId id) { return world.joint_state(id).broken; });
}

// Exception: a breaking constraint is drawn anew.
TEST(Markers, TakeNoMemoryOnceTheyAreThere) {
  for (engine::World& world : scenes()) {
    Listener listener;
    bool touched = false;
    std::size_t allocations = 0;
    for (int round = 0; round < 100; ++round) {
      const std::ptrdiff_t broken = broken_joints(world);
      run(&world, kRound);
      const bool has_broken = broken_joints(world) > broken;
      const std::size_t before = engine::counted_allocations();
      listener.hear_only(world);
      // contacts may exceed their largest number so far
      touched = touched || !world.contacts().empty();
      if (round > 0 && !touched && !has_broken)
        allocations += engine::counted_allocations() - before;
    }
    EXPECT_EQ(allocations, 0u);
  }
}

TEST(Markers, OfWhatRestsAreSentOnceASecond) {
  engine::World world = engine::load_scene(
      "world: {sleep_after: 0.1}\n"
      "bodies: [{name: floor, type: static, shape: {plane: {}}},"
      " {name: ball, mass: 1, shape: {sphere: {radius: 0.1}}, position: [0, 0, 0.1]}]");
  run(&world, 1.0);
  Listener listener;
  listener.hear(world);
  int sent = 0;
  for (int round = 0; round < 100; ++round) {
    run(&world, kRound);
    const MarkerArray array = listener.hear(world);
    sent += static_cast<int>(std::count_if(array.markers.begin(), array.markers.end(),
                                           [](const Marker& m) { return m.ns == "bodies"; }));
  }
  EXPECT_EQ(sent, 2 * 2);
}

TEST(Markers, SpringsAreNeverRedAndOthersAre) {
  engine::World world = engine::load_scene(
      "world: {method: sequential_impulses, gravity: [0, 0, 0]}\n"
      "bodies: [{name: a, mass: 1, shape: {point: {}}, position: [3, 0, 0]},"
      " {name: b, mass: 1, shape: {point: {}}, position: [3, 1, 0]}]\n"
      "constraints: [{name: s, type: spring, body_b: a, frequency: 0.01, length: 1},"
      " {name: r, body_b: b, anchor_a: [0, 1, 0], length: 1}]");
  world.step();
  const MarkerArray array = Listener().hear(world);
  const auto color = [&](const char* name) {
    const Marker* found =
        find(array, "constraints", static_cast<std::int32_t>(world.find_joint(name).value));
    return found->color;
  };
  EXPECT_GT(std::abs(world.joint_state(world.find_joint("s")).error), 1.0);
  EXPECT_LT(color("s").r, 0.3F);
  EXPECT_GT(color("r").r, 0.7F);
  EXPECT_LT(color("r").g, 0.3F);
}

// Two balls on a rope over a pulley, and one on a rod: 9.81 N each, in one colour.
TEST(Markers, ARopeOverAPulleyBearsWhatHangsOnIt) {
  engine::World world = engine::load_scene(
      "bodies: [{name: a, mass: 1, shape: {point: {}}, position: [1, 0, 1]},"
      " {name: b, mass: 1, shape: {point: {}}, position: [2, 0, 1]},"
      " {name: c, mass: 1, shape: {point: {}}, position: [3, 0, 1]}]\n"
      "constraints: [{name: first, free: true, anchor_a: [1, 0, 2], body_b: a},"
      " {name: second, free: true, anchor_a: [2, 0, 2], body_b: b},"
      " {name: rope, type: pulley, joints: [first, second], ratio: 1},"
      " {name: rod, anchor_a: [3, 0, 2], body_b: c}]");
  world.step();
  const MarkerArray array = Listener().hear(world);
  const auto color = [&](const char* name) {
    return find(array, "constraints", static_cast<std::int32_t>(world.find_joint(name).value))
        ->color;
  };
  const std_msgs::ColorRGBA none = constraint_colour(0.0, 0.0);
  EXPECT_GT(std::abs(color("rod").g - none.g) + std::abs(color("rod").b - none.b), 0.1F);
  for (const char* name : {"first", "second", "rope"}) {
    EXPECT_NEAR(color(name).r, color("rod").r, 1e-6) << name;
    EXPECT_NEAR(color(name).g, color("rod").g, 1e-6) << name;
    EXPECT_NEAR(color(name).b, color("rod").b, 1e-6) << name;
  }
}

TEST(Markers, OfWhatBreaksAreGreyForTwoSeconds) {
  engine::World world = engine::load_scene(
      "bodies: [{name: a, mass: 1, shape: {point: {}}, position: [1, 0, 0]},"
      " {name: b, mass: 1, shape: {point: {}}, position: [3, 0, 0]}]\n"
      "constraints: [{name: s, body_b: a}, {name: r, body_b: b, break_force: 15}]");
  const engine::JointId rod = world.find_joint("r");
  const auto id = static_cast<std::int32_t>(rod.value);
  Listener listener;
  double broke = -1.0;
  bool is_gone = false;
  while (world.time() < 5.0) {
    run(&world, kRound);
    const bool is_broken = world.joint_state(rod).broken;
    if (is_broken && broke < 0.0) broke = world.time();
    const MarkerArray array = listener.hear(world, false, is_broken && broke == world.time());
    const Marker* marker = find(array, "constraints", id);
    if (!is_broken) {
      ASSERT_NE(marker, nullptr);
      EXPECT_NE(marker->color.r, marker->color.g);
    } else if (world.time() < broke + 2.0 - 1e-6) {
      ASSERT_NE(marker, nullptr) << world.time();
      EXPECT_EQ(marker->action, Marker::ADD);
      EXPECT_EQ(marker->color.r, marker->color.g);
      EXPECT_EQ(marker->color.g, marker->color.b);
      ASSERT_EQ(marker->points.size(), 4u);  // two parts, from the anchors on
      const auto length = [&](std::size_t i, std::size_t j) {
        const auto &p = marker->points[i], &q = marker->points[j];
        return Vector3d(q.x - p.x, q.y - p.y, q.z - p.z).norm();
      };
      // The parts are apart, and neither is along the line between the anchors: a line there hides
      // at most one.
      const auto place = [&](std::size_t i) {
        return Vector3d(marker->points[i].x, marker->points[i].y, marker->points[i].z);
      };
      const Vector3d along = (place(3) - place(0)).normalized();
      const Vector3d first = (place(1) - place(0)).normalized();
      const Vector3d second = (place(2) - place(3)).normalized();
      EXPECT_GT(length(1, 2), 0.3 * length(0, 3));
      EXPECT_LT(first.dot(along), 0.97);
      EXPECT_LT(-second.dot(along), 0.97);
      const Vector3d aside = first - first.dot(along) * along;  // bends are perpendicular
      EXPECT_NEAR(aside.dot(second), 0.0, 1e-9);
    } else if (!is_gone) {
      ASSERT_NE(marker, nullptr);
      EXPECT_EQ(marker->action, Marker::DELETE);
      is_gone = true;
    } else {
      EXPECT_EQ(marker, nullptr);
    }
  }
  EXPECT_GT(broke, 0.0);
  EXPECT_TRUE(is_gone);
}

// Parts beside the first one are in a namespace of their own, where no body has an id.
TEST(Markers, EachShapeOfABodyHasOne) {
  const char* const shapes =
      "shapes: [{shape: {box: {size: [1, 2, 3]}}}, {shape: {sphere: {radius: 0.5}}, shape_pose: "
      "{position: [0, 0, 2]}}, {shape: {sphere: {radius: 0.1}}, shape_pose: {position: [1, 0, "
      "0]}}]";
  engine::World world = engine::load_scene(
      std::string("bodies: [{name: a, mass: 1, inertia: [1, 1, 1], position: [5, 0, 0], ") +
      shapes +
      "}, {name: b, mass: 1, shape: {sphere: {radius: 1}}, position: [9, 0, 0]}, {name: c, mass: "
      "1, "
      "inertia: [1, 1, 1], orientation: [1, 0, 0, 0], position: [20, 0, 0], " +
      shapes + "}]");
  Listener listener;
  const MarkerArray array = listener.hear(world);
  const auto id_of = [&](const char* name) {
    return static_cast<std::int32_t>(world.find_body(name).value);
  };
  const auto is_of_shape = [](const Marker& m) { return m.ns == "bodies" || m.ns == "parts"; };
  ASSERT_EQ(std::count_if(array.markers.begin(), array.markers.end(), is_of_shape), 7);
  const Marker* box = find(array, "bodies", id_of("a"));
  EXPECT_EQ(box->type, Marker::CUBE);
  EXPECT_EQ(box->scale.y, 2.0);
  EXPECT_EQ(box->pose.position.x, 5.0);
  EXPECT_EQ(find(array, "bodies", id_of("b"))->type, Marker::SPHERE);
  EXPECT_EQ(find(array, "parts", 0)->scale.x, 1.0);
  EXPECT_EQ(find(array, "parts", 0)->pose.position.z, 2.0);
  EXPECT_EQ(find(array, "parts", 1)->pose.position.x, 6.0);
  EXPECT_EQ(find(array, "parts", 2)->pose.position.z, -2.0);  // turned upside down
  world.remove_body(world.find_body("a"));
  const MarkerArray later = listener.hear(world, false, true);
  EXPECT_EQ(find(later, "parts", 2)->action, Marker::DELETE);
  EXPECT_EQ(find(later, "parts", 0)->pose.position.x, 20.0);
}

TEST(Markers, StaticBodiesAreMutedAndColoursAreTheBodies) {
  engine::World world = engine::load_scene(
      "bodies: [{name: wall, type: static, shape: {box: {size: [1, 1, 1]}}},"
      " {name: a, mass: 1, shape: {sphere: {radius: 0.1}}, position: [5, 0, 0]},"
      " {name: b, mass: 1, shape: {sphere: {radius: 0.1}}, position: [6, 0, 0],"
      " color: [0.1, 0.9, 0.4, 0.5]}]");
  const MarkerArray array = Listener().hear(world);
  const auto spread = [&](const char* name) {
    const auto& c =
        find(array, "bodies", static_cast<std::int32_t>(world.find_body(name).value))->color;
    return std::max({c.r, c.g, c.b}) - std::min({c.r, c.g, c.b});
  };
  EXPECT_LT(spread("wall"), 0.05F);
  EXPECT_GT(spread("a"), 0.3F);
  const auto& own =
      find(array, "bodies", static_cast<std::int32_t>(world.find_body("b").value))->color;
  EXPECT_FLOAT_EQ(own.g, 0.9F);
  EXPECT_FLOAT_EQ(own.a, 0.5F);
}

TEST(Markers, TheLargestContactForceComesOutOfWhatItHolds) {
  engine::World world = engine::load_scene(
      "bodies: [{name: floor, type: static, shape: {plane: {}}}, {name: block, mass: 1,"
      " shape: {box: {size: [1, 1, 1]}}, position: [0, 0, 0.5]}]");
  run(&world, 0.1);
  const MarkerArray array = Listener().hear(world);
  const Marker* normal = find(array, "contacts", 0);
  ASSERT_NE(normal, nullptr);
  double top = 0.0;
  for (const auto& point : normal->points) top = std::max(top, point.z);
  EXPECT_NEAR(top, 1.3, 1e-6);
}

// A sliding ball, which hides everything within its radius.
TEST(Markers, ForcesOnABallAreSeenAroundIt) {
  engine::World world = engine::load_scene(
      "bodies: [{name: floor, type: static, shape: {plane: {}}, friction: 0.5},"
      " {name: ball, mass: 1, shape: {sphere: {radius: 0.5}}, position: [0, 0, 0.5],"
      " linear_velocity: [5, 0, 0], friction: 0.5},"
      " {name: pebble, mass: 1e-3, shape: {sphere: {radius: 0.5}}, position: [5, 0, 0.5],"
      " linear_velocity: [5, 0, 0], friction: 0.5}]");
  run(&world, 0.05);
  ASSERT_EQ(world.contacts().size(), 2u);
  const MarkerArray array = Listener().hear(world);
  for (const char* ns : {"contacts", "friction"}) {
    const Marker* marker = find(array, ns, 0);
    ASSERT_NE(marker, nullptr) << ns;
    for (const auto& point : marker->points)
      for (const char* name : {"ball", "pebble"})
        EXPECT_GT(
            (Vector3d(point.x, point.y, point.z) - world.state(world.find_body(name)).position)
                .norm(),
            0.5 - 1e-6)  // the ball dips into the floor by rounding
            << ns << name;
  }
}

// A light sliding box beside a heavy one has a short arrow, whose head is still visible.
TEST(Markers, HeadsOfFrictionAreNeverSmall) {
  engine::World world = engine::load_scene(
      "bodies: [{name: floor, type: static, shape: {plane: {}}, friction: 0.5},"
      " {name: heavy, mass: 10, shape: {box: {size: [1, 1, 1]}}, position: [0, 0, 0.5]},"
      " {name: light, mass: 4, shape: {box: {size: [1, 1, 1]}}, position: [3, 0, 0.5],"
      " linear_velocity: [5, 0, 0], friction: 0.5}]");
  run(&world, 0.1);
  Listener listener;
  const MarkerArray array = listener.hear(world);
  const Marker* friction = find(array, "friction", 0);
  ASSERT_NE(friction, nullptr);
  const double longest = 1.3;  // out of the heavy box
  for (std::size_t i = 0; i + 9 < friction->points.size(); i += 10) {
    const auto place = [&](std::size_t k) {
      const auto& p = friction->points[i + k];
      return Vector3d(p.x, p.y, p.z);
    };
    const Vector3d along = place(1) - place(0);
    const double head = (place(2) - place(3)).dot(along.normalized());
    EXPECT_LT(0.2 * along.norm(), 0.1 * longest);  // head size by the arrow's length alone
    EXPECT_NEAR(head, 0.1 * longest, 1e-6);
  }
}

// Cubes mark lengths whose other end is the world; a spring off a body's centre has an arm.
TEST(Markers, EndsAtTheWorldAreMarkedAndArmsOfSpringsDrawn) {
  engine::World world = engine::load_scene(
      "bodies: [{name: a, mass: 1, shape: {box: {size: [0.1, 0.1, 0.1]}}, position: [0, 0, 1]},"
      " {name: b, mass: 1, shape: {box: {size: [0.1, 0.1, 0.1]}}, position: [2, 0, 1]}]\n"
      "constraints: [{name: spring, type: spring, anchor_a: [0, 1, 2], body_b: a,"
      " anchor_b: [0, 0.5, 0], frequency: 1}, {name: rod, body_a: a, body_b: b},"
      " {name: hinge, type: hinge, anchor_a: [2, 0, 1], axis_a: [0, 1, 0], body_b: b}]");
  Listener listener;
  const auto id = static_cast<std::int32_t>(world.find_joint("spring").value);
  for (int round = 0; round < 3; ++round) {
    const MarkerArray array = listener.hear(world);
    const Marker* fixed = find(array, "fixed", 0);
    ASSERT_EQ(fixed != nullptr, round == 0);  // the marker is sent once only
    if (fixed != nullptr) {
      ASSERT_EQ(fixed->points.size(), 1u);
      EXPECT_EQ(fixed->points[0], point_at({0.0, 1.0, 2.0}));
    }
    const Marker* arm = find(array, "joints", id);
    ASSERT_NE(arm, nullptr);
    ASSERT_EQ(arm->points.size(), 2u);
    const engine::JointId joint = world.find_joint("spring");
    const Vector3d ends[] = {world.state(world.find_body("a")).position, world.anchors(joint).p_b};
    for (std::size_t i = 0; i < 2; ++i) {
      const auto& p = arm->points[i];
      EXPECT_LT((Vector3d(p.x, p.y, p.z) - ends[i]).norm(), 1e-12);  // rounding
    }
    run(&world, kRound);
  }
  world.remove_joint(world.find_joint("spring"));
  const MarkerArray array = listener.hear(world, false, true);
  const Marker* fixed = find(array, "fixed", 0);
  ASSERT_NE(fixed, nullptr);
  EXPECT_EQ(fixed->action, Marker::DELETE);
}

TEST(Markers, ContactsWithoutAForceHaveNoArrow) {
  engine::World world = engine::load_scene(
      "world: {gravity: [0, 0, 0]}\n"
      "bodies: [{name: a, mass: 1, shape: {sphere: {radius: 0.5}}},"
      " {name: b, mass: 1, shape: {sphere: {radius: 0.5}}, position: [1, 0, 0]}]");
  world.step();
  EXPECT_EQ(find(Listener().hear(world), "contacts", 0), nullptr);
}

// Rods that carry 9.81 N, a hundredth of that, and nothing.
TEST(Markers, TheKindOfLoadIsAColourAndItsAmountAWidth) {
  engine::World world = engine::load_scene(
      "bodies: [{name: a, mass: 1, shape: {point: {}}, position: [0, 0, 1]},"
      " {name: b, mass: 0.01, shape: {point: {}}, position: [1, 0, 1]},"
      " {name: c, mass: 0.01, shape: {point: {}}, position: [2, 0, 3]},"
      " {name: d, mass: 1e-9, shape: {point: {}}, position: [3, 0, 1]}]\n"
      "constraints: [{name: heavy, anchor_a: [0, 0, 2], body_b: a},"
      " {name: light, anchor_a: [1, 0, 2], body_b: b},"
      " {name: pushed, anchor_a: [2, 0, 2], body_b: c},"
      " {name: idle, anchor_a: [3, 0, 2], body_b: d}]");
  world.step();
  const MarkerArray array = Listener().hear(world);
  const auto marker = [&](const char* name) {
    return *find(array, "constraints", static_cast<std::int32_t>(world.find_joint(name).value));
  };
  EXPECT_EQ(marker("light").color, marker("heavy").color);
  EXPECT_EQ(marker("heavy").color, constraint_colour(-1.0, 0.0));
  EXPECT_EQ(marker("pushed").color, constraint_colour(1.0, 0.0));
  EXPECT_EQ(marker("idle").color, constraint_colour(0.0, 0.0));
  EXPECT_GT(marker("heavy").scale.x, 1.5 * marker("light").scale.x);
}

// ---- labels

class LabelsTest : public testing::Test {
 protected:
  std::vector<Marker> shown(const engine::World& world) {
    const ros::Time stamp(100.0 + world.time());
    forces_.update(world, stamp);
    return array_of(labels_.update(world, forces_, stamp, true)).markers;
  }
  std::vector<Marker> legend_of(const engine::World& world) {
    std::vector<Marker> lines;
    for (const Marker& marker : shown(world))
      if (marker.ns == "legend" && marker.action == Marker::ADD) lines.push_back(marker);
    return lines;
  }
  // Returns texts of these namespaces, in order.
  std::vector<std::string> texts_of(const engine::World& world,
                                    const std::vector<std::string>& namespaces) {
    std::vector<std::string> texts;
    for (const Marker& marker : shown(world)) {
      if (marker.action != Marker::ADD ||
          std::find(namespaces.begin(), namespaces.end(), marker.ns) == namespaces.end())
        continue;
      const std::size_t first = marker.text.find_first_not_of(' ');
      texts.push_back(marker.text.substr(first, marker.text.find_last_not_of(' ') + 1 - first));
    }
    return texts;
  }
  Labels labels_{"world"};
  ForceScale forces_;
};

TEST_F(LabelsTest, TellForTwoSecondsWhatBroke) {
  engine::World world = engine::load_scene(
      "bodies: [{name: bob, mass: 1, shape: {sphere: {radius: 0.1}}, position: [0, 0, 1]}]\n"
      "constraints: [{name: rod, anchor_a: [0, 0, 2], body_b: bob, break_force: 5}]");
  const auto tells = [&] {
    const std::vector<std::string> texts = texts_of(world, {"legend", "forces"});
    return texts == std::vector<std::string>{"broke beyond 5 N", "small cubes: fixed to the world",
                                             "grey, in two parts: broken"};
  };
  EXPECT_FALSE(tells());
  run(&world, 0.1);
  EXPECT_TRUE(world.joint_state(world.find_joint("rod")).broken);
  EXPECT_TRUE(tells());
  run(&world, 1.8);
  EXPECT_TRUE(tells());
  run(&world, 0.3);
  EXPECT_FALSE(tells());
  labels_.forget();  // a later subscriber has seen nothing break
  EXPECT_FALSE(tells());
}

TEST_F(LabelsTest, HaveTheLegendAboveShapesThatAreOffTheirBodies) {
  const engine::World world = engine::load_scene(
      "bodies: [{name: mast, mass: 1, inertia: [1, 1, 1], shape: {box: {size: [0.1, 0.1, 2]}},"
      " shape_pose: {position: [0, 0, 3], orientation: [0, 0, 0, 1]}}]\n"
      "constraints: [{name: foot, type: ball, body_b: mast}]");
  const std::vector<Marker> lines = legend_of(world);
  ASSERT_EQ(lines.size(), 1u);
  EXPECT_GT(lines.front().pose.position.z, 4.0);
}

TEST_F(LabelsTest, TellInTheLegendWhatIsThere) {
  using Texts = std::vector<std::string>;
  const auto legend = [&](const std::string& scene) {
    engine::World world = engine::load_scene(scene);
    world.step();
    labels_.forget();
    forces_ = ForceScale();
    return texts_of(world, {"legend"});
  };
  const std::string bob =
      "bodies: [{name: bob, mass: 1, shape: {sphere: {radius: 0.1}}, position: [0, 0, 1]}]\n";
  EXPECT_EQ(legend(bob), Texts());
  EXPECT_EQ(legend(bob + "constraints: [{name: rod, anchor_a: [0, 0, 2], body_b: bob}]"),
            (Texts{"small cubes: fixed to the world", "cyan: tension, at most 9.81 N"}));
  EXPECT_EQ(legend(bob + "constraints: [{name: rod, body_b: bob}]"),
            (Texts{"small cubes: fixed to the world", "yellow: compression, at most 9.81 N"}));
  EXPECT_EQ(
      legend("world: {gravity: [0, 0, 0]}\n" + bob + "constraints: [{name: rod, body_b: bob}]"),
      (Texts{"green: no force", "small cubes: fixed to the world"}));
  EXPECT_EQ(legend(bob + "constraints: [{name: hinge, type: hinge, body_b: bob,"
                         " anchor_a: [0, 0, 1], axis_a: [0, 1, 0], motor: {bias: 1}}]"),
            Texts{"pink: motors, which way they move"});
  // an arm within its body is not visible
  EXPECT_EQ(legend(bob + "constraints: [{name: ball, type: ball, body_b: bob,"
                         " anchor_a: [0, 0, 1.1], anchor_b: [0, 0, 0.1]}]"),
            Texts{"light grey: joints, their axes and rails"});
  EXPECT_EQ(legend(bob + "constraints: [{name: ball, type: ball, body_b: bob,"
                         " anchor_a: [0, 0, 1.5], anchor_b: [0, 0, 0.5]}]"),
            (Texts{"green: arms of bodies to joints", "light grey: joints, their axes and rails"}));
  EXPECT_EQ(legend("world: {gravity: [0, 0, 0]}\n"
                   "bodies: [{name: a, mass: 1, shape: {sphere: {radius: 0.5}}},"
                   " {name: b, mass: 1, shape: {sphere: {radius: 0.5}}, position: [1, 0, 0]}]"),
            Texts());  // the spheres touch
}

// A ball circling at 3 m/s pulls with 9 N more than at rest. Only the present force is shown.
TEST_F(LabelsTest, TellTheForcesOfNow) {
  engine::World world = engine::load_scene(
      "world: {time_step: 0.0001}\n"
      "bodies: [{name: bob, mass: 1, shape: {sphere: {radius: 0.1}}, position: [0, 0, 1],"
      " linear_velocity: [3, 0, 0]}]\n"
      "constraints: [{name: rope, type: rope, anchor_a: [0, 0, 2], body_b: bob, max_length: 1}]");
  using Texts = std::vector<std::string>;
  world.step();
  EXPECT_EQ(
      texts_of(world, {"legend", "forces"}),
      (Texts{"rope 18.8 N", "small cubes: fixed to the world", "cyan: tension, at most 18.8 N"}));
  engine::BodyState rest = world.state(world.find_body("bob"));
  rest.linear_velocity.setZero();
  world.set_state(world.find_body("bob"), rest);
  world.step();
  EXPECT_EQ(
      texts_of(world, {"legend", "forces"}),
      (Texts{"rope 9.81 N", "small cubes: fixed to the world", "cyan: tension, at most 9.81 N"}));
}

// Labels of hanging lines are above their upper ends, in the colour of the line, without overlap.
// Labels of legs are beside them, a fifth of their length above their feet.
TEST_F(LabelsTest, AreWhereTheirLineIsFixed) {
  for (const char* name : {"newtons_cradle", "stewart_platform"}) {
    engine::World world = load_world(name, "", Parameters(), Caller::kParameter);
    run(&world, 0.1);
    const bool stands = std::string(name) == "stewart_platform";
    const std::vector<Marker> labels = shown(world);
    const MarkerArray markers = Listener().hear(world);
    std::vector<const Marker*> forces;
    for (const Marker& label : labels) {
      if (label.ns == "forces") forces.push_back(&label);
      if (label.ns != "forces" && label.ns != "motor_rates") continue;
      const auto anchors = world.anchors({static_cast<std::uint32_t>(label.id)});
      const double share = stands ? (label.id % 2 == 1 ? 0.4 : 0.2) : 0.0;
      const Vector3d end = (1.0 - share) * anchors.p_a + share * anchors.p_b;
      const auto& at = label.pose.position;
      EXPECT_NEAR(at.x, end.x(), 1e-12);
      EXPECT_NEAR(at.y, end.y(), 1e-12);
      EXPECT_LT(std::abs(at.z - end.z()), (stands ? 1.5 : 4.0) * label.scale.z);
      EXPECT_TRUE(stands || at.z - end.z() > 0.5 * label.scale.z);
      const Marker* line = find(markers, "constraints", label.id);
      if (label.ns == "forces") {
        EXPECT_EQ(label.color, line->color);
      }
    }
    EXPECT_GE(forces.size(), 5u);
    for (const Marker* one : forces)
      for (const Marker* other : forces) {
        if (one == other) continue;
        const auto &a = one->pose.position, &b = other->pose.position;
        const double height = one->scale.z;
        if (stands) {  // seen from the side, labels to the right and to the left of lines may meet
          EXPECT_TRUE(one->id % 2 == other->id % 2 || std::abs(a.z - b.z) > 2.0 * height)
              << one->id << other->id;
          continue;
        }
        const double width = 0.5 * height * static_cast<double>(one->text.size());
        EXPECT_TRUE(std::hypot(a.x - b.x, a.y - b.y) > width || std::abs(a.z - b.z) > height)
            << name << one->id << other->id;
      }
  }
}

TEST_F(LabelsTest, TellWhichWayAMotorDrivesALength) {
  for (const char* type : {"rope, max_length: 1", "distance, length: 1"}) {
    for (const double rate : {0.05, -0.05}) {
      engine::World world = engine::load_scene(
          "bodies: [{name: bob, mass: 1, shape: {sphere: {radius: 0.1}}, position: [0, 0, 1]}]\n"
          "constraints: [{name: winch, anchor_a: [0, 0, 2], body_b: bob, motor: {bias: " +
          std::to_string(rate) + "}, type: " + type + "}]");
      world.step();
      EXPECT_EQ(texts_of(world, {"motor_rates"}),
                std::vector<std::string>{rate < 0.0 ? "shortens 0.05 m/s" : "extends 0.05 m/s"});
    }
  }
}

// A load of 20 N pulls out a winch of 5 N; a winch without length left reports that.
TEST_F(LabelsTest, TellWhichLimitAMotorIsAt) {
  engine::World world = engine::load_scene(
      "bodies: [{name: bob, mass: 2, shape: {sphere: {radius: 0.1}}, position: [0, 0, 1]},"
      " {name: door, mass: 1, shape: {box: {size: [1, 0.1, 1]}}, position: [3, 0, 1]}]\n"
      "constraints: [{name: winch, type: rope, max_length: 1, anchor_a: [0, 0, 2], body_b: bob,"
      " motor: {bias: -1, max_force: 5}},"
      " {name: hinge, type: hinge, anchor_a: [2.5, 0, 1], axis_a: [0, 1, 0], body_b: door,"
      " motor: {bias: -1, max_force: 0.5}}]");
  world.step();
  EXPECT_EQ(texts_of(world, {"motor_rates"}),
            (std::vector<std::string>{"shortens 1 m/s, at its limit of 5 N",
                                      "door -1 rad/s, at its limit of 0.5 N m"}));
  EXPECT_EQ(texts_of(world, {"legend"}).back(),
            "pink: motors, which way they move; dark at their limit");
}

// A bar on its upper limit, a slide on its lower one, a plate on a short strut, a ball on a long
// one; and bodies at no limit.
TEST_F(LabelsTest, TellWhichLimitIsReached) {
  engine::World world = engine::load_scene(
      "bodies: [{name: bar, mass: 1, shape: {box: {size: [1, 0.1, 0.1]}}, position: [0.5, 0, 1]},"
      " {name: slide, mass: 1, shape: {box: {size: [0.1, 0.1, 0.1]}}, position: [2, 0, 1]},"
      " {name: free, mass: 1, shape: {box: {size: [0.1, 0.1, 0.1]}}, position: [3, 0, 1]},"
      " {name: plate, mass: 1, shape: {point: {}}, position: [4, 0, 1]},"
      " {name: ball, mass: 1, shape: {point: {}}, position: [5, 0, 1]}]\n"
      "constraints: [{name: hinge, type: hinge, body_b: bar, anchor_a: [0, 0, 1],"
      " axis_a: [0, 1, 0], upper: 0.25},"
      " {name: slider, type: slider, body_b: slide, anchor_a: [2, 0, 1], axis_a: [0, 0, 1],"
      " lower: -0.2, upper: 1},"
      " {name: other, type: slider, body_b: free, anchor_a: [3, 0, 1], axis_a: [1, 0, 0],"
      " lower: -0.2, upper: 1},"
      " {name: prop, type: strut, body_b: plate, anchor_a: [4, 0, 0], min_length: 0.95},"
      " {name: tie, type: distance, body_b: ball, anchor_a: [5, 0, 2], min_length: 0.5,"
      " max_length: 1.05}]");
  EXPECT_EQ(texts_of(world, {"limits"}), std::vector<std::string>());
  run(&world, 2.0);
  EXPECT_EQ(texts_of(world, {"limits"}),
            (std::vector<std::string>{"at upper limit 0.25 rad", "at lower limit -0.2 m",
                                      "at lower limit 0.95 m", "at upper limit 1.05 m"}));
}

TEST_F(LabelsTest, HaveLargerLettersWhereTheSceneGoesFar) {
  engine::World world = engine::load_scene(
      "world: {gravity: [0, 0, 0]}\n"
      "bodies: [{name: a, mass: 1, shape: {sphere: {radius: 0.1}}}]");
  const auto height = [&] { return shown(world).back().scale.z; };
  const double at_rest = height();
  EXPECT_EQ(height(), at_rest);
  engine::BodyState state = world.state(world.find_body("a"));
  state.linear_velocity.x() = 0.5;
  world.set_state(world.find_body("a"), state);
  EXPECT_GT(height(), at_rest);
  run(&world, 5.0);
  EXPECT_DOUBLE_EQ(height(), 2.0 * at_rest);  // upper bound
}

// ---- contacts

// A block on a slope of 0.4 rad, held by friction or sliding.
TEST(Markers, ContactArrowsPointOutOfWhatHoldsAndFrictionUpTheSlope) {
  for (const double mu : {0.6, 0.2}) {
    for (const char* method : {"event_driven", "sequential_impulses"}) {
      const std::string friction = std::to_string(mu);
      engine::World world = engine::load_scene(
          std::string("world: {sleep_after: .inf, method: ") + method +
          "}\nbodies: [{name: slope, type: static, shape: {plane: {}}, friction: " + friction +
          ", orientation: [0, 0.19866933079506122, 0, 0.98006657784124163]},"
          " {name: block, mass: 2, shape: {box: {size: [0.6, 0.5, 0.4]}}, friction: " +
          friction +
          ", position: [0.07788366846173, 0, 0.18421219880058],"
          " orientation: [0, 0.19866933079506122, 0, 0.98006657784124163]}]");
      run(&world, 0.5);
      const MarkerArray array = Listener().hear(world);
      const Marker* normal = find(array, "contacts", 0);
      const bool sticks = mu > std::tan(0.4);
      const Marker* along = find(array, "friction", sticks ? 1 : 0);
      ASSERT_NE(normal, nullptr) << method << mu;
      ASSERT_NE(along, nullptr) << method << mu;
      EXPECT_EQ(find(array, "friction", sticks ? 0 : 1), nullptr) << method << mu;
      const Vector3d up(std::sin(0.4), 0.0, std::cos(0.4)),
          uphill(-std::cos(0.4), 0.0, std::sin(0.4));
      // the sum over the points of a held block alone is determined
      const auto together = [](const Marker& marker) {
        Vector3d sum = Vector3d::Zero();
        for (std::size_t i = 0; i + 9 < marker.points.size(); i += 10) {
          const auto& a = marker.points[i];
          const auto& b = marker.points[i + 1];
          sum += Vector3d(b.x - a.x, b.y - a.y, b.z - a.z);
        }
        return sum;
      };
      const Vector3d normals = together(*normal), frictions = together(*along);
      EXPECT_GT(normals.normalized().dot(up), 0.999) << method << mu;
      EXPECT_GT(frictions.normalized().dot(uphill), 0.999) << method << mu;
      // The block, which covers 0.3 m uphill and downhill of its centre, would hide the arrows.
      // Those of impulses are at the block's place when the tick began, and it slides by at most 1
      // cm a tick.
      const auto& at = world.state(world.find_body("block")).position;
      for (std::size_t i = 0; i + 9 < along->points.size(); i += 10)
        for (const std::size_t end : {i, i + 1}) {
          const auto& p = along->points[end];
          EXPECT_GT(std::abs((Vector3d(p.x, p.y, p.z) - at).dot(uphill)), 0.3 - 0.011)
              << method << mu;
        }
      // on one scale; impulses have the sweeps' residual
      EXPECT_NEAR(frictions.norm() / normals.norm(), std::min(mu, std::tan(0.4)), 0.01)
          << method << mu;
    }
  }
}

// ---- joints

// The ring of a motor: its points follow each other like a point of the rotating body, at the upper
// end of the axis, outside the body of 0.4 m by 0.2 m by 0.6 m. No arrow points along the axis,
// which would mean sliding.
TEST(Markers, AMotorsArrowTurnsAsItsBody) {
  for (const char* axis : {"[0, 0, 1]", "[0, 0, -1]", "[1, 0, 0]", "[1, 2, -3]"}) {
    for (const double rate : {0.5, -0.5}) {
      engine::World world = engine::load_scene(
          std::string(
              "world: {gravity: [0, 0, 0]}\nbodies: [{name: b, mass: 1, shape: {box: {size: "
              "[0.4, 0.2, 0.6]}}, position: [1, 2, 3]}]\nconstraints: [{name: h, type: "
              "hinge, anchor_a: [1, 2, 3], body_b: b, axis_a: ") +
          axis + ", motor: {bias: " + std::to_string(rate) + "}}]");
      world.step();
      const engine::BodyState& body = world.state(world.find_body("b"));
      const Vector3d turning = body.angular_velocity;
      ASSERT_NEAR(turning.norm(), 0.5, 1e-9);
      const MarkerArray array = Listener().hear(world);
      const Marker* marker =
          find(array, "motors", static_cast<std::int32_t>(world.find_joint("h").value));
      ASSERT_NE(marker, nullptr);
      const auto& q = marker->pose.orientation;
      const Eigen::Quaterniond turn(q.w, q.x, q.y, q.z);
      const auto place = [&](std::size_t i) -> Vector3d {
        const auto& p = marker->points[i];
        return turn * Vector3d(p.x, p.y, p.z);
      };
      // the longest runs of connected lines
      int runs = 0;
      for (std::size_t i = 0; i + 3 < marker->points.size(); i += 2) {
        if ((place(i + 1) - place(i + 2)).norm() > 1e-9) continue;
        if ((place(i + 3) - place(i)).norm() < (place(i + 1) - place(i)).norm()) continue;
        ++runs;
        EXPECT_GT(place(i).cross(place(i + 1)).dot(turning), 0.0) << axis << rate;
      }
      EXPECT_GT(runs, 15) << axis << rate;
      const Vector3d along = turning.normalized();
      for (std::size_t i = 0; i < marker->points.size(); i += 2) {
        const Vector3d line = place(i + 1) - place(i);
        EXPECT_LT(std::abs(line.dot(along)), 0.7 * line.norm()) << axis << rate;
      }
      double inside = 0.0;  // end of the body along the axis
      for (int i = 0; i < 8; ++i)
        inside =
            std::max(inside, (body.orientation *
                              Vector3d(i & 1 ? 0.2 : -0.2, i & 2 ? 0.1 : -0.1, i & 4 ? 0.3 : -0.3))
                                 .dot(along));
      const Vector3d end = place(0).dot(along) * along;
      EXPECT_GT(end.norm(), inside) << axis << rate;
      EXPECT_GE(end.z(), -1e-9) << axis << rate;
    }
  }
}

// Two wheels in external contact, with radii by the ratio of their angles; one in a ring of 60
// teeth around a sun of 12; a rack.
TEST(Markers, WheelsOfGearsTouch) {
  const auto sizes = [](const engine::World& world, const char* name) {
    const engine::Joint& gear = world.joint(world.find_joint(name));
    std::pair<JointSize, JointSize> found(size_of(world, world.joint(gear.coupling.first)),
                                          size_of(world, world.joint(gear.coupling.second)));
    find_wheels(world, gear, &found.first, &found.second);
    return found;
  };
  const engine::World joints =
      engine::load_scene_file(std::string(CONSTRAINT_SIM_SOURCE_DIR) + "/docs/images/joints.yaml");
  const auto [wheel, small] = sizes(joints, "gear");
  EXPECT_NEAR(wheel.wheel, 0.25, 1e-12);  // 0.4 m apart, ratio 0.6
  EXPECT_NEAR(small.wheel, 0.15, 1e-12);
  EXPECT_EQ(wheel.teeth, 20);
  EXPECT_EQ(small.teeth, 12);
  const auto [pinion, rack] = sizes(joints, "rack_and_pinion");
  EXPECT_NEAR(pinion.wheel, 0.1, 1e-12);  // 10 rad a metre
  EXPECT_EQ(rack.wheel, 0.0);
  EXPECT_NEAR(rack.rack.norm(), 0.1, 1e-12);  // the axle is 0.2 m from the rack's centre
  const engine::World planetary = load_world("gear_train", "", Parameters(), Caller::kParameter);
  const auto [sun, planet] = sizes(planetary, "outer_mesh");
  EXPECT_NEAR(sun.wheel, 0.12, 1e-12);
  EXPECT_NEAR(planet.wheel, 0.24, 1e-12);
  const auto [again, ring] = sizes(planetary, "ring_mesh");
  EXPECT_NEAR(again.wheel, 0.24, 1e-12);
  EXPECT_NEAR(ring.wheel, 0.6, 1e-12);
  EXPECT_TRUE(ring.wheel_is_on_a);
  EXPECT_EQ(ring.teeth, 30);
}

// A gear with touching wheels has no line between its joints; others have one.
TEST(Markers, OfGearsAreLinesOnlyWhereNoWheelsTouch) {
  const auto is_drawn = [](const std::string& scene, const char* name) {
    const engine::World world = load_world(scene, "", Parameters(), Caller::kParameter);
    const auto id = static_cast<std::int32_t>(world.find_joint(name).value);
    return find(Listener().hear(world), "constraints", id) != nullptr;
  };
  EXPECT_FALSE(is_drawn("gear_train", "ring_mesh"));
  EXPECT_FALSE(is_drawn("gear_train", "outer_mesh"));
  const engine::World apart = engine::load_scene(
      "bodies: [{name: a, mass: 1, shape: {box: {size: [0.1, 0.1, 0.1]}}},"
      " {name: b, mass: 1, shape: {box: {size: [0.1, 0.1, 0.1]}}, position: [9, 0, 0]}]\n"
      "constraints: [{name: h, type: hinge, body_b: a, axis_a: [0, 0, 1]},"
      " {name: i, type: hinge, body_b: b, anchor_a: [9, 0, 0], axis_a: [0, 0, 1]},"
      " {name: g, type: gear, joints: [h, i], ratio: 1}]");
  const auto id = static_cast<std::int32_t>(apart.find_joint("g").value);
  EXPECT_NE(find(Listener().hear(apart), "constraints", id), nullptr);
}

// ---- the view

/// Returns the place of a point in a view, from -1 (left, lower edge) to 1 in the window of rviz's
/// shipped configuration; z is the depth along the line of sight [m].
Vector3d in_view(const View& view, const Vector3d& point) {
  // Field of view of rviz: 45 degrees from top to bottom, and the aspect of its shipped window.
  const double half_height = std::tan(std::atan(1.0) / 2.0), aspect = 1.75;
  const Vector3d to_eye(std::cos(view.yaw) * std::cos(view.pitch),
                        std::sin(view.yaw) * std::cos(view.pitch), std::sin(view.pitch));
  const Vector3d right(-std::sin(view.yaw), std::cos(view.yaw), 0.0), up = to_eye.cross(right);
  const Vector3d p = point - view.focal_point;
  const double depth = view.distance - p.dot(to_eye);
  return {p.dot(right) / (aspect * half_height * depth), p.dot(up) / (half_height * depth), depth};
}

TEST(View, ShowsAllOfASceneAndLarge) {
  for (const double size : {0.01, 0.1, 1.0, 100.0}) {
    for (const Vector3d& shape : {Vector3d(1.0, 1.0, 1.0), Vector3d(1.0, 0.02, 0.02),
                                  Vector3d(0.02, 1.0, 0.02), Vector3d(0.02, 0.02, 1.0)}) {
      Extent extent;
      extent.low = Vector3d(3.0, -2.0, 7.0);
      extent.high = extent.low + size * shape;
      const View view = fitted_view(extent);
      double farthest = 0.0;
      for (int i = 0; i < 8; ++i) {
        const Vector3d corner((i & 1 ? extent.high : extent.low).x(),
                              (i & 2 ? extent.high : extent.low).y(),
                              (i & 4 ? extent.high : extent.low).z());
        const Vector3d seen = in_view(view, corner);
        EXPECT_GT(seen.z(), 0.0);
        farthest = std::max({farthest, std::abs(seen.x()), std::abs(seen.y())});
      }
      EXPECT_NEAR(farthest, 0.85, 1e-9);
    }
  }
}

TEST(View, HasWhatMovesInItAndNotWhatFallsAway) {
  const engine::World pendulum = engine::load_scene(
      "bodies: [{name: bob, mass: 1, shape: {sphere: {radius: 0.1}}, position: [2, 0, 3]}]\n"
      "constraints: [{name: rod, anchor_a: [0, 0, 3], body_b: bob}]");
  const View view = fitted_view(seen_extent(pendulum));
  for (const Vector3d& point : {Vector3d(2, 0, 3), Vector3d(0, 0, 1), Vector3d(-2, 0, 3)}) {
    const Vector3d seen = in_view(view, point);
    EXPECT_LT(std::max(std::abs(seen.x()), std::abs(seen.y())), 1.0);
  }
  const Extent falling = seen_extent(engine::load_scene(
      "bodies: [{name: bob, mass: 1, shape: {sphere: {radius: 0.1}}, position: [0, 0, 3]}]"));
  EXPECT_LT((falling.high - falling.low).norm(), 4.0 * std::sqrt(3.0) * 0.2);  // falls by 44 m
}

}  // namespace
}  // namespace constraint_sim
