// Fields of structs are listed once, in engine/model/fields.h: this test compares the lists with
// the structs. A member that no list has would be in no saved scene and no snapshot.

#include <gtest/gtest.h>

#include <set>
#include <string>

#include "engine/model/fields.h"

namespace constraint_sim::engine {
namespace {

/// Expects a list with this many members, in the order of the struct, each with a key of its own.
template <class Struct>
void expect_listed(std::size_t members) {
  Struct object;
  std::set<std::string> keys;
  const char* last = nullptr;
  const auto visit = [&](const char* key, const auto& value, auto) {
    EXPECT_TRUE(keys.insert(key).second) << key;
    const auto* const at = reinterpret_cast<const char*>(&value);
    EXPECT_GT(at, last) << key;
    last = at;
  };
  visit_fields(object, visit);
  EXPECT_EQ(keys.size(), members);
}

// Structured bindings need exactly as many names as a struct has members: a struct with another
// number of members does not compile.
TEST(Fields, AreAllListed) {
  [[maybe_unused]] const auto& [s1] = Sphere{};
  expect_listed<Sphere>(1);
  [[maybe_unused]] const auto& [x1] = Box{};
  expect_listed<Box>(1);
  [[maybe_unused]] const auto& [y1, y2] = Cylinder{};
  expect_listed<Cylinder>(2);
  [[maybe_unused]] const auto& [z1, z2] = Capsule{};
  expect_listed<Capsule>(2);
  [[maybe_unused]] const auto& [h1] = Hull{};
  expect_listed<Hull>(1);
  static_assert(std::is_empty_v<Point> && std::is_empty_v<Plane>, "list the new field");
  [[maybe_unused]] const auto& [p1, p2] = ShapePose{};
  expect_listed<ShapePose>(2);
  [[maybe_unused]] const auto& [t1, t2, t3, t4] = BodyState{};
  expect_listed<BodyState>(4);
  [[maybe_unused]] const auto& [b1, b2, b3, b4, b5, b6, b7, b8, b9, b10, b11, b12, b13, b14] =
      Body{};
  expect_listed<Body>(13 + 4);  // the keys of the state stand beside the others
  [[maybe_unused]] const auto& [l1, l2, l3, l4, l5, l6, l7, l8] = DistanceJoint{};
  expect_listed<DistanceJoint>(8);
  [[maybe_unused]] const auto& [m1, m2, m3, m4, m5, m6, m7, m8, m9, m10, m11, m12] = Motor{};
  expect_listed<Motor>(12);
  [[maybe_unused]] const auto& [c1, c2, c3, c4, c5, c6, c7, c8, c9, c10, c11, c12] =
      CoordinateLaw{};
  expect_listed<CoordinateLaw>(12);
}

/// Expects structs to differ that differ in one field.
template <class Struct>
void expect_compared() {
  const Struct object;
  EXPECT_TRUE(are_same(object, Struct{}));
  std::apply(
      [&](const auto&... field) {
        const auto expect_differing = [&](const auto& each) {
          Struct changed;
          auto& value = changed.*each.member;
          using Value = std::decay_t<decltype(value)>;
          if constexpr (std::is_same_v<Value, std::optional<Motor>>)
            value.emplace();
          else if constexpr (std::is_same_v<Value, bool>)
            value = !value;
          else
            value = 0.25;
          EXPECT_FALSE(are_same(object, changed)) << each.key;
          EXPECT_TRUE(are_same(changed, Struct(changed))) << each.key;
        };
        (expect_differing(field), ...);
      },
      kFields<Struct>);
}

TEST(Fields, AreAllCompared) {
  expect_compared<DistanceJoint>();
  expect_compared<Motor>();
  expect_compared<CoordinateLaw>();
  CoordinateLaw law, other;
  law.motor.emplace().servo_damping = 1.0;
  other.motor.emplace().servo_damping = 2.0;
  EXPECT_FALSE(are_same(law, other));
}

}  // namespace
}  // namespace constraint_sim::engine
