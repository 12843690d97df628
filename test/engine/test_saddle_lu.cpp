// Newton systems of bodies and rows against dense factorisations: trees, loops, nets, and singular
// blocks in regular matrices.

#include "counted_allocations.h"
#include "dense_systems.h"
#include "engine/math/list.h"
#include "engine/math/saddle_lu.h"
#include "problems.h"
#include "rotation_between.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

/// A link between two bodies, or between a body and the world.
struct BodyLink {
  int a, b = -1;
  int rows = 1;
};

/// Nodes as in ImplicitStep: leaves before roots, rows with the body further from the root.
struct System {
  SaddleLu lu;
  MatrixXd A;
  List<int> first_of_body, first_of_link;

  System(const List<int>& dofs, const List<int>& parents, const List<BodyLink>& held) {
    List<SaddleLu::Node> nodes;
    List<SaddleLu::Link> links(held.size());
    int unknown = 0;
    for (int body = 0; body < static_cast<int>(dofs.size()); ++body) {
      const auto i = static_cast<std::size_t>(body);
      nodes.push_back({dofs[i], 0, parents[i]});
      first_of_body.push_back(unknown);
      unknown += dofs[i];
      for (std::size_t l = 0; l < held.size(); ++l) {
        const bool is_lower = held[l].b < 0 || held[l].a < held[l].b;
        if ((is_lower ? held[l].a : held[l].b) != body) continue;
        links[l] = {unknown, held[l].rows, body, is_lower ? held[l].b : held[l].a};
        unknown += held[l].rows;
        nodes[i].rows += held[l].rows;
      }
    }
    for (const SaddleLu::Link& link : links) first_of_link.push_back(link.first);
    lu.analyze(nodes, links);
    A = MatrixXd::Zero(unknown, unknown);
  }

  /// Fills [K, -Gᵀ; G, 0] with K near the identity and unsymmetric rows: G and the transposed block
  /// differ as much as in a step that bends the mechanism.
  void fill(const List<int>& dofs, const List<BodyLink>& held, Random* random) {
    for (std::size_t i = 0; i < dofs.size(); ++i)
      block(first_of_body[i], first_of_body[i], dofs[i], dofs[i], 0.2, random) +=
          MatrixXd::Identity(dofs[i], dofs[i]);
    for (std::size_t l = 0; l < held.size(); ++l) {
      const int row = first_of_link[l];
      for (const int end : {held[l].a, held[l].b}) {
        if (end < 0) continue;
        const auto i = static_cast<std::size_t>(end);
        auto G = block(row, first_of_body[i], held[l].rows, dofs[i], 1.0, random);
        block(first_of_body[i], row, dofs[i], held[l].rows, 0.1, random) -= G.transpose();
      }
      if (held[l].b < 0) continue;
      const auto a = static_cast<std::size_t>(held[l].a);
      const auto b = static_cast<std::size_t>(held[l].b);
      block(first_of_body[a], first_of_body[b], dofs[a], dofs[b], 0.1, random);
      block(first_of_body[b], first_of_body[a], dofs[b], dofs[a], 0.1, random);
    }
  }

  Eigen::Block<MatrixXd> block(int row, int column, int rows, int columns, double size,
                               Random* random) {
    auto part = A.block(row, column, rows, columns);
    for (int i = 0; i < rows; ++i)
      for (int j = 0; j < columns; ++j) part(i, j) = size * (*random)();
    return part;
  }

  bool solve(VectorXd* x) {
    std::fill(lu.values().begin(), lu.values().end(), 0.0);
    for (int i = 0; i < A.rows(); ++i)
      for (int j = 0; j < A.cols(); ++j)
        if (A(i, j) != 0.0) lu.values()[lu.slot(i, j)] = A(i, j);
    return lu.solve(x->data());
  }

  /// Expects a residual of at most 1e-10 of the largest sum of |A| |x| + |b|, as refinements and
  /// the check of a forest guarantee.
  void expect_solved(const char* what) {
    const VectorXd b = VectorXd::LinSpaced(A.rows(), -1.0, 1.0);
    VectorXd x = b;
    ASSERT_TRUE(solve(&x)) << what;
    const VectorXd size = A.cwiseAbs() * x.cwiseAbs() + b.cwiseAbs();
    EXPECT_LE((b - A * x).cwiseAbs().maxCoeff(), 2e-10 * size.maxCoeff()) << what;
  }
};

struct Graph {
  const char* name;
  List<int> dofs, parents;
  List<BodyLink> held;
};

/// n bodies, each held by the next one, the last by the world.
Graph chain(int n, int dofs, int rows) {
  Graph graph{"chain", {}, {}, {}};
  for (int i = 0; i < n; ++i) {
    graph.dofs.push_back(dofs);
    graph.parents.push_back(i + 1 < n ? i + 1 : -1);
    graph.held.push_back({i, i + 1 < n ? i + 1 : -1, rows});
  }
  return graph;
}

/// n × n points with a row to each neighbour; the tree goes along one side and then across.
Graph net(int n) {
  Graph graph{"net", {}, {}, {}};
  for (int i = 0; i < n; ++i) {
    for (int k = 0; k < n; ++k) {
      const int body = i * n + k;
      graph.dofs.push_back(3);
      graph.parents.push_back(k + 1 < n ? body + 1 : (i + 1 < n ? body + n : -1));
      if (k + 1 < n) graph.held.push_back({body, body + 1});
      if (i + 1 < n) graph.held.push_back({body, body + n});
    }
  }
  graph.held.push_back({n * n - 1, -1});
  return graph;
}

List<Graph> graphs() {
  List<Graph> all{chain(1, 3, 1), chain(30, 3, 1), chain(20, 6, 3), net(3), net(9), net(12)};
  Graph through_world = chain(8, 6, 3);  // no block is singular: 6 rows hold the last body
  through_world.name = "chain held at both ends";
  through_world.held.push_back({0, -1, 3});
  all.push_back(through_world);
  Graph linkage = chain(
      3, 6,
      5);  // Bennett's linkage: 10 rows in a block of 6 degrees of freedom, one of them redundant
  linkage.name = "linkage through the world";
  linkage.held.push_back({0, -1, 2});
  all.push_back(linkage);
  Graph to_parent = chain(2, 6, 1);  // 4 rows of a point, all to a rotating body
  to_parent.name = "point with four rods";
  to_parent.dofs[0] = 3;
  for (int k = 0; k < 3; ++k) to_parent.held.push_back({0, 1});
  all.push_back(to_parent);
  Graph ring = chain(12, 6, 3);
  ring.name = "ring";
  ring.held.push_back({0, 11, 3});
  all.push_back(ring);
  return all;
}

TEST(SaddleLu, SolvesForestsLoopsAndNets) {
  Random random;
  for (const Graph& graph : graphs()) {
    System system(graph.dofs, graph.parents, graph.held);
    for (int k = 0; k < 3; ++k) {
      system.fill(graph.dofs, graph.held, &random);
      system.expect_solved(graph.name);
    }
  }
}

// Errors are found with A⁻¹ of the dense factorisation, since residuals may be small regardless.
TEST(SaddleLu, AgreesWithADenseFactorisation) {
  Random random;
  for (const Graph& graph : graphs()) {
    System system(graph.dofs, graph.parents, graph.held);
    system.fill(graph.dofs, graph.held, &random);
    const VectorXd b = VectorXd::LinSpaced(system.A.rows(), -1.0, 1.0);
    VectorXd x = b;
    ASSERT_TRUE(system.solve(&x)) << graph.name;
    // ‖A⁻¹‖ times the remaining residual, at most 1e-10 of 2 ‖A‖ ‖x‖
    const double norm = system.A.cwiseAbs().rowwise().sum().maxCoeff();
    const double inverse = dense_inverse(system.A).cwiseAbs().rowwise().sum().maxCoeff();
    const double largest = x.cwiseAbs().maxCoeff();
    EXPECT_LE((x - dense_solution(system.A, b)).cwiseAbs().maxCoeff(),
              2e-10 * norm * inverse * largest)
        << graph.name;
  }
}

/// Points in a straight line on rods, held at both ends: each has two rows of one direction.
System straight_cable(int points, const Graph& graph) {
  System system(graph.dofs, graph.parents, graph.held);
  const Vector3d along(0.6, 0.0, 0.8);
  for (int i = 0; i < points; ++i)
    system.A
        .block<3, 3>(system.first_of_body[static_cast<std::size_t>(i)],
                     system.first_of_body[static_cast<std::size_t>(i)])
        .setIdentity();
  for (std::size_t l = 0; l < graph.held.size(); ++l) {
    double sign = 1.0;
    for (const int end : {graph.held[l].a, graph.held[l].b}) {
      if (end < 0) continue;
      const int first = system.first_of_body[static_cast<std::size_t>(end)];
      system.A.block<1, 3>(system.first_of_link[l], first) = sign * along.transpose();
      system.A.block<3, 1>(first, system.first_of_link[l]) = -sign * along;
      sign = -1.0;
    }
  }
  return system;
}

// Point 0 has rows to the next point and to the world along one line: its own block is singular. A
// spring between the last point and the world makes the whole matrix regular.
TEST(SaddleLu, SolvesWhereTheBlockOfANodeIsSingular) {
  constexpr int kPoints = 5;
  Graph graph = chain(kPoints, 3, 1);
  graph.held.push_back({0, -1});
  System system = straight_cable(kPoints, graph);
  system.A(system.first_of_link[kPoints - 1], system.first_of_link[kPoints - 1]) = 0.5;
  ASSERT_EQ(dense_rank(system.A, 1e-10), system.A.rows());
  system.expect_solved("straight cable");
}

TEST(SaddleLu, FindsOutWhereTheMatrixIsSingular) {
  constexpr int kPoints = 5;
  Graph graph = chain(kPoints, 3, 1);
  graph.held.push_back({0, -1});
  System system = straight_cable(kPoints, graph);  // a rod is redundant
  ASSERT_LT(dense_rank(system.A, 1e-10), system.A.rows());
  VectorXd b = VectorXd::LinSpaced(system.A.rows(), -1.0, 1.0);
  EXPECT_FALSE(system.solve(&b));
}

// Slightly changed matrices are solved by refinement with old factors; largely changed ones are
// not.
TEST(SaddleLu, GoesOnWithOldFactorsOnlyAsTheyServe) {
  Random random;
  const Graph graph = net(12);
  System system(graph.dofs, graph.parents, graph.held);
  system.fill(graph.dofs, graph.held, &random);
  const MatrixXd from = system.A;
  system.fill(graph.dofs, graph.held, &random);
  const MatrixXd to = system.A;
  for (const double share : {0.0, 1e-12, 1e-6, 1e-3, 0.01, 0.1, 0.5, 1.0}) {
    system.A = from + share * (to - from);
    system.expect_solved("net that changes");
  }
}

TEST(SaddleLu, IsTheSameToTheBitAfterForgettingAndInCopies) {
  Random random;
  for (const Graph& graph : graphs()) {
    System system(graph.dofs, graph.parents, graph.held);
    system.fill(graph.dofs, graph.held, &random);
    const VectorXd b = VectorXd::LinSpaced(system.A.rows(), -1.0, 1.0);
    VectorXd first = b, other = b, again = b;
    ASSERT_TRUE(system.solve(&first));
    const MatrixXd A = system.A;
    system.A += 1e-4 * A;
    System copy = system;
    ASSERT_TRUE(system.solve(&other));
    VectorXd of_copy = b;
    ASSERT_TRUE(copy.solve(&of_copy));
    EXPECT_TRUE(of_copy == other) << graph.name;
    system.A = A;
    system.lu.forget();
    ASSERT_TRUE(system.solve(&again));
    EXPECT_TRUE(again == first) << graph.name;
  }
}

// The number of delayed pivots depends on the matrix, so each matrix is solved twice.
TEST(SaddleLu, AllocatesNothingOnceItsArraysHaveTheirLargestSize) {
  for (const Graph& graph : graphs()) {
    System system(graph.dofs, graph.parents, graph.held);
    VectorXd b = VectorXd::LinSpaced(system.A.rows(), -1.0, 1.0);
    for (const bool is_warm : {false, true}) {
      Random random;
      for (int k = 0; k < 5; ++k) {
        system.fill(graph.dofs, graph.held, &random);
        const std::size_t before = counted_allocations();
        ASSERT_TRUE(system.solve(&b));
        const std::size_t allocated = counted_allocations() - before;
        EXPECT_EQ(is_warm ? allocated : 0, 0u) << graph.name;
        system.lu.forget();
      }
    }
  }
}

// ---- in the engine

/// Bars on ball joints from corner to corner of a polygon whose last side is the world.
World linkage(int sides, double stiffness) {
  World world(options(0.01));
  const auto corner = [&](int i) {
    const double angle = 2.0 * kPi * i / sides + 0.3;
    return Vector3d(std::cos(angle), 0.1 * (i % 2), std::sin(angle));
  };
  std::vector<BodyId> bars;
  for (int i = 0; i + 1 < sides; ++i) {
    const Vector3d along = corner(i + 1) - corner(i);
    Body bar = make_body("bar_" + std::to_string(i), Box{{along.norm(), 0.1, 0.1}}, 1.0,
                         0.5 * (corner(i) + corner(i + 1)));
    bar.no_collision = true;
    bar.state.orientation = rotation_between(Vector3d::UnitX(), along);
    bars.push_back(world.add_body(bar));
  }
  for (int i = 0; i < sides; ++i) {
    const BodyId a = i > 0 ? bars[static_cast<std::size_t>(i) - 1] : kWorldBody;
    const BodyId b = i + 1 < sides ? bars[static_cast<std::size_t>(i)] : kWorldBody;
    const auto anchor = [&](BodyId id, double side) -> Vector3d {
      if (id == kWorldBody) return corner(i);
      return {side * 0.5 * std::get<Box>(world.body(id).shape).size.x(), 0.0, 0.0};
    };
    const std::string name = "ball_" + std::to_string(i);
    if (b == kWorldBody)
      world.add_joint(make_joint(name, b, corner(i), a, anchor(a, 1.0), JointKind::kBall));
    else
      world.add_joint(make_joint(name, a, anchor(a, 1.0), b, anchor(b, -1.0), JointKind::kBall));
  }
  world.add_joint(make_joint("spring", bars[0], Vector3d::Zero(), bars[1], Vector3d::Zero(),
                             spring(0.3, stiffness, 0.0)));
  return world;
}

// Two balls and possibly a spring hold the last bar of the loop: its rows alone are as many as its
// degrees of freedom, or more.
TEST(SaddleLu, LetsNewtonConvergeInLoopsThroughTheWorld) {
  for (const int sides : {4, 5}) {
    for (const double time_step : {0.1, 0.01, 0.001}) {
      World world = linkage(sides, 100.0);
      WorldOptions options = world.options();
      options.time_step = time_step;
      options.method = Method::kEnergyMomentum;
      world.set_options(options);
      double iterations = 0.0, substeps = 0.0;
      for (int i = 0; i < 100; ++i) {
        const StepReport& report = world.step();
        EXPECT_LE(report.joints.max_error, round_off(world));
        const Island island = world.islands().front();
        ASSERT_EQ(island.method, Method::kEnergyMomentum) << sides << " sides, " << time_step;
        iterations += island.iterations;
        substeps += island.substeps;
      }
      // quadratic convergence: from 1e-1 to below 1e-18 in 6, and fewer for shorter steps
      EXPECT_LE(iterations / substeps, 7.0) << sides << " sides, " << time_step;
    }
  }
}

}  // namespace
}  // namespace constraint_sim::engine
