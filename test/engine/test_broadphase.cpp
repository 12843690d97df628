#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "draw.h"
#include "engine/collision/broadphase.h"
#include "engine/math/list.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;
using Pairs = List<Broadphase::Pair>;

Proxy cube(int body, const Vector3d& centre, double size, bool movable = true) {
  const Vector3d half = Vector3d::Constant(0.5 * size);
  return {{centre - half, centre + half}, body, movable};
}

Proxy plane_proxy(int body) { return {bounds(Plane{}, BodyState{}), body, false}; }

Pairs all_pairs(const List<Proxy>& proxies) {
  Pairs pairs;
  for (const Proxy& a : proxies) {
    for (const Proxy& b : proxies) {
      const bool touch = (a.box.min.array() <= b.box.max.array()).all() &&
                         (b.box.min.array() <= a.box.max.array()).all();
      if (a.body < b.body && (a.movable || b.movable) && touch) pairs.push_back({a.body, b.body});
    }
  }
  std::sort(pairs.begin(), pairs.end());
  return pairs;
}

TEST(Overlap, IsInclusiveAlongEachAxis) {
  const Aabb unit{Vector3d::Zero(), Vector3d::Ones()};
  for (int axis = 0; axis < 3; ++axis) {
    for (const double sign : {-1.0, 1.0}) {
      const auto moved = [&](double distance) {
        const Vector3d shift = sign * distance * Vector3d::Unit(axis);
        return Aabb{unit.min + shift, unit.max + shift};
      };
      const double step = std::pow(2.0, -50);  // exact beside 1
      EXPECT_TRUE(overlap(unit, moved(1.0 - step)));
      EXPECT_TRUE(overlap(unit, moved(1.0)));
      EXPECT_FALSE(overlap(unit, moved(1.0 + step)));
      EXPECT_FALSE(overlap(moved(1.0 + step), unit));
    }
  }
}

TEST(Bounds, OfAPointAndASphere) {
  BodyState state;
  state.position = {1.0, 2.0, 3.0};
  state.orientation = Eigen::AngleAxisd(0.7, Vector3d::UnitX());
  EXPECT_EQ(bounds(Point{}, state).min, state.position);
  EXPECT_EQ(bounds(Point{}, state).max, state.position);
  EXPECT_EQ(bounds(Sphere{0.5}, state).min, Vector3d(0.5, 1.5, 2.5));
  EXPECT_EQ(bounds(Sphere{0.5}, state).max, Vector3d(1.5, 2.5, 3.5));
}

TEST(Bounds, OfATurnedBoxAreThoseOfItsVertices) {
  Draw random(7);
  for (int trial = 0; trial < 100; ++trial) {
    const Box box{random.vector_between(0.0, 1.0) + Vector3d::Constant(0.1)};
    BodyState state;
    state.position = 10.0 * random.vector_between(0.0, 1.0);
    state.orientation =
        Eigen::AngleAxisd(6.0 * random.share(),
                          (random.vector_between(0.0, 1.0) - Vector3d::Constant(0.5)).normalized());

    Aabb expected{Vector3d::Constant(kInfinity), Vector3d::Constant(-kInfinity)};
    for (int vertex = 0; vertex < 8; ++vertex) {
      const Vector3d corner(vertex & 1 ? 0.5 : -0.5, vertex & 2 ? 0.5 : -0.5,
                            vertex & 4 ? 0.5 : -0.5);
      const Vector3d p = state.position + state.orientation * corner.cwiseProduct(box.size);
      expected.min = expected.min.cwiseMin(p);
      expected.max = expected.max.cwiseMax(p);
    }
    // a few roundings at coordinates up to 11
    EXPECT_TRUE(bounds(box, state).min.isApprox(expected.min, 1e-14));
    EXPECT_TRUE(bounds(box, state).max.isApprox(expected.max, 1e-14));
  }
}

TEST(Bounds, OfAPlaneAreInfinite) {
  const Aabb box = bounds(Plane{}, BodyState{});
  EXPECT_EQ(box.min, Vector3d::Constant(-kInfinity));
  EXPECT_EQ(box.max, Vector3d::Constant(kInfinity));
}

TEST(Broadphase, OfNothingOrOneBodyHasNoPairs) {
  Broadphase broadphase;
  EXPECT_TRUE(broadphase.find_pairs({}).empty());
  EXPECT_EQ(broadphase.tests(), 0u);
  EXPECT_TRUE(broadphase.find_pairs({cube(0, Vector3d::Zero(), 1.0)}).empty());
  EXPECT_TRUE(broadphase.find_pairs({plane_proxy(0)}).empty());
  EXPECT_TRUE(broadphase.find_pairs({plane_proxy(0), plane_proxy(1)}).empty());
}

TEST(Broadphase, OrdersThePairsByBodyWhateverTheOrderOfTheProxies) {
  Broadphase broadphase;
  const Pairs expected{{2, 5}, {2, 9}, {5, 9}};
  EXPECT_EQ(broadphase.find_pairs({cube(9, Vector3d::Zero(), 1.0), plane_proxy(5),
                                   cube(2, Vector3d::Constant(0.5), 1.0)}),
            expected);
  EXPECT_EQ(broadphase.tests(), 3u);
}

TEST(Broadphase, FindsTouchingBoxesAndNotThoseJustApart) {
  Broadphase broadphase;
  const double step = std::pow(2.0, -50);  // exact beside 1
  EXPECT_EQ(broadphase
                .find_pairs({cube(0, Vector3d::Zero(), 1.0), cube(1, Vector3d::UnitY(), 1.0),
                             cube(2, Vector3d(0.0, 0.0, -1.0 - step), 1.0)})
                .size(),
            1u);
}

TEST(Broadphase, PairsNothingWithinTheImmovable) {
  Broadphase broadphase;
  List<Proxy> proxies{plane_proxy(0)};
  for (int i = 1; i < 100; ++i) proxies.push_back(cube(i, Vector3d::Zero(), 1.0, false));
  EXPECT_TRUE(broadphase.find_pairs(proxies).empty());
  EXPECT_EQ(broadphase.tests(), 0u);
}

TEST(Broadphase, PairsEverythingAtOnePlace) {
  Broadphase broadphase;
  List<Proxy> proxies;
  for (int i = 0; i < 50; ++i) proxies.push_back(cube(i, Vector3d::Zero(), 1.0));
  EXPECT_EQ(broadphase.find_pairs(proxies), all_pairs(proxies));
  EXPECT_EQ(broadphase.find_pairs(proxies).size(), 50u * 49u / 2u);
}

TEST(Broadphase, AgreesWithAllPairs) {
  Draw random(7);
  Broadphase broadphase;  // shared by all trials, so that leftovers of a call would show
  std::size_t found = 0;
  for (int trial = 0; trial < 300; ++trial) {
    const int n = static_cast<int>(120.0 * random.share());
    const double extent = 1.0 + 10.0 * random.share();
    List<Proxy> proxies;
    for (int i = 0; i < n; ++i) {
      // Sizes over four decades; one in ten is a plane, some of them moving; some boxes are
      // half-bounded.
      const double size = std::pow(10.0, 4.0 * random.share() - 3.0);
      Proxy proxy =
          cube(3 * i + 1, extent * random.vector_between(0.0, 1.0), size, random.share() < 0.7);
      if (random.share() < 0.1) proxy.box = plane_proxy(0).box;
      if (random.share() < 0.05) proxy.box.max.x() = kInfinity;
      proxies.push_back(proxy);
    }
    for (int i = n - 1; i > 0; --i)
      std::swap(proxies[i], proxies[static_cast<int>(i * random.share())]);

    EXPECT_EQ(broadphase.find_pairs(proxies), all_pairs(proxies)) << "trial " << trial;
    found += all_pairs(proxies).size();
  }
  EXPECT_GT(found, 10000u);
}

TEST(Broadphase, DoesTheSameWorkInACopyAndInASecondCall) {
  Draw random(7);
  List<Proxy> proxies;
  for (int i = 0; i < 500; ++i)
    proxies.push_back(cube(i, 5.0 * random.vector_between(0.0, 1.0), 0.5));
  Broadphase broadphase;
  const Pairs pairs = broadphase.find_pairs(proxies);
  const std::uint64_t tests = broadphase.tests();
  Broadphase copy = broadphase;
  EXPECT_EQ(copy.find_pairs(proxies), pairs);
  EXPECT_EQ(copy.tests(), tests);
  EXPECT_EQ(broadphase.find_pairs(proxies), pairs);
  EXPECT_EQ(broadphase.tests(), tests);
}

TEST(Broadphase, KeepsItsMemory) {
  Draw random(7);
  List<Proxy> proxies{plane_proxy(1000)};
  for (int i = 0; i < 500; ++i)
    proxies.push_back(cube(i, 5.0 * random.vector_between(0.0, 1.0), 0.5));
  Broadphase broadphase;
  const Pairs* const pairs = &broadphase.find_pairs(proxies);
  const Broadphase::Pair* const memory = pairs->data();
  EXPECT_EQ(broadphase.find_pairs(proxies).data(), memory);
}

double tests_of(const List<Proxy>& proxies) {
  Broadphase broadphase;
  broadphase.find_pairs(proxies);
  return static_cast<double>(broadphase.tests());
}

/// Returns the exponent of the growth of tests from 100 to 10 000 bodies.
template <class Arrangement>
double slope(const Arrangement& arrangement) {
  return std::log10(tests_of(arrangement(10000)) / tests_of(arrangement(100))) / 2.0;
}

// Each body touches a bounded number of others, so the tree needs a bounded number of tests per
// body, and slightly more near its border: the bound is an exponent of 1.1.

TEST(Broadphase, TestsGrowWithTheBodiesInAColumnOfAnyOrder) {
  const auto column = [](int n) {
    List<Proxy> proxies;
    for (int i = 0; i < n; ++i) proxies.push_back(cube(i, Vector3d::UnitZ() * (i * 7919 % n), 1.0));
    return proxies;
  };
  EXPECT_LE(slope(column), 1.1);
}

TEST(Broadphase, TestsGrowWithTheBodiesOnBigBoxes) {
  const auto balls_on_boxes = [](int n) {
    const int side = static_cast<int>(std::ceil(std::sqrt(n)));
    List<Proxy> proxies{cube(n, Vector3d(0.0, 0.0, -10.0), 20.0),
                        cube(n + 1, Vector3d(0.0, 0.0, -500.0), 1000.0, false)};
    for (int i = 0; i < n; ++i) {
      proxies.push_back(cube(i, Vector3d(0.5 * (i % side), 0.5 * (i / side), 0.25), 0.5));
    }
    return proxies;
  };
  EXPECT_LE(slope(balls_on_boxes), 1.1);
}

}  // namespace
}  // namespace constraint_sim::engine
