// Functions with the same bits on every machine: their errors against numbers with more digits,
// their bits as a hash, and the dense algebra beside them.

#include <cstdint>
#include <cstring>
#include <functional>
#include <random>

#include "dense_systems.h"
#include "engine/math/dense.h"
#include "engine/math/elementary.h"
#include "engine/model/mass_properties.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr int kArguments = 1000000 / kSanitizedShare;

/// Random numbers that are equal with every standard library.
class Arguments {
 public:
  double uniform(double least, double most) {
    return least + (most - least) * static_cast<double>(bits_() >> 11) * 0x1p-53;
  }
  double sign() { return (bits_() & 1) != 0 ? -1.0 : 1.0; }
  /// Returns a number with an exponent from `least` to `most`.
  double spread(int least, int most) {
    const auto range = static_cast<std::uint64_t>(most - least);
    const double signed_one = sign();  // separate statements: compilers may reorder operands
    const double significand = uniform(1.0, 2.0);
    return signed_one * std::ldexp(significand, least + static_cast<int>(bits_() % range));
  }
  /// Returns small and large angles, and angles near multiples of π/2 [rad].
  double angle(int i) {
    switch (i % 5) {
      case 0:
        return uniform(-0.8, 0.8);
      case 1:
        return uniform(-10.0, 10.0);
      case 2:
        return uniform(-2e6, 2e6);
      case 3:
        return spread(-60, 1023);
      default: {
        const double multiple = static_cast<double>(bits_() % 2000000) * (0.5 * kPi);
        return multiple * uniform(1.0 - 1e-15, 1.0);
      }
    }
  }
  /// Returns coordinates of a point, of similar or very different sizes.
  double coordinate(int i) { return i % 2 == 0 ? uniform(-1.0, 1.0) : spread(-600, 500); }

 private:
  std::mt19937_64 bits_{1};
};

double unit_in_last_place(long double value) {
  int exponent = 0;
  std::frexp(static_cast<double>(value), &exponent);
  return std::ldexp(1.0, std::max(exponent, -1021) - 53);
}

/// Largest error of `got` [ulp] over drawn arguments.
class Errors {
 public:
  void add(double got, long double exact) {
    const auto error = static_cast<double>(std::abs(got - exact)) / unit_in_last_place(exact);
    if (!(error <= largest_)) largest_ = error;
  }
  double largest() const { return largest_; }

 private:
  double largest_ = 0.0;
};

// long double has 11 more bits on x86 and 60 more on ARM
static_assert(std::numeric_limits<long double>::digits >= 64);

TEST(Elementary, SineAndCosineAreWithinTheirErrors) {
  Arguments draw;
  Errors sine, cosine;
  for (int i = 0; i < kArguments; ++i) {
    const double x = draw.angle(i);
    const math::SineCosine both = math::sin_cos(x);
    ASSERT_EQ(both.sine, math::sin(x)) << x;
    ASSERT_EQ(both.cosine, math::cos(x)) << x;
    sine.add(both.sine, std::sin(static_cast<long double>(x)));
    cosine.add(both.cosine, std::cos(static_cast<long double>(x)));
  }
  EXPECT_LT(sine.largest(), 0.8);
  EXPECT_LT(cosine.largest(), 0.8);
}

TEST(Elementary, ArcTangentRootsAndLengthsAreWithinTheirErrors) {
  Arguments draw;
  Errors arc_tangent, plane, space, fifth;
  for (int i = 0; i < kArguments; ++i) {
    const double x = draw.coordinate(i), y = draw.coordinate(i / 2), z = draw.coordinate(i / 4);
    const long double x_long = x, y_long = y, z_long = z;
    arc_tangent.add(math::atan2(y, x), std::atan2(y_long, x_long));
    plane.add(math::hypot(x, y), std::sqrt(x_long * x_long + y_long * y_long));
    space.add(math::hypot(x, y, z), std::sqrt(x_long * x_long + y_long * y_long + z_long * z_long));
    fifth.add(math::fifth_root(std::abs(x)), std::pow(std::abs(x_long), 0.2L));
  }
  EXPECT_LT(arc_tangent.largest(), 1.0);
  EXPECT_LT(plane.largest(), 1.25);
  EXPECT_LT(space.largest(), 1.6);
  EXPECT_LT(fifth.largest(), 1.0);
}

TEST(Elementary, ZerosInfinitiesAndNaNAreAsInC) {
  for (const double x : {0.0, -0.0}) {
    EXPECT_EQ(std::signbit(math::sin(x)), std::signbit(x));
    EXPECT_EQ(std::signbit(math::sin_cos(x).sine), std::signbit(x));
    EXPECT_EQ(math::cos(x), 1.0);
  }
  for (const double x : {kInfinity, -kInfinity, kNaN}) {
    EXPECT_TRUE(std::isnan(math::sin(x)));
    EXPECT_TRUE(std::isnan(math::cos(x)));
    EXPECT_TRUE(std::isnan(math::sin_cos(x).sine));
  }
  const double special[] = {0.0,     -0.0,  1.0,    -1.0,      5e-324,
                            -5e-324, 1e308, -1e308, kInfinity, -kInfinity};
  for (const double x : special) {
    for (const double y : special) {
      const double expected = std::atan2(y, x);
      EXPECT_DOUBLE_EQ(math::atan2(y, x), expected) << y << ' ' << x;
      EXPECT_EQ(std::signbit(math::atan2(y, x)), std::signbit(expected)) << y << ' ' << x;
      EXPECT_DOUBLE_EQ(math::hypot(x, y), std::hypot(x, y)) << y << ' ' << x;
      EXPECT_DOUBLE_EQ(math::hypot(x, 0.0, y), std::hypot(x, y)) << y << ' ' << x;
    }
    EXPECT_TRUE(std::isnan(math::atan2(kNaN, x)));
    EXPECT_TRUE(std::isnan(math::atan2(x, kNaN)));
  }
  EXPECT_EQ(math::hypot(kInfinity, kNaN), kInfinity);
  EXPECT_TRUE(std::isnan(math::hypot(1.0, kNaN)));
  EXPECT_EQ(math::fifth_root(0.0), 0.0);
  EXPECT_EQ(math::fifth_root(kInfinity), kInfinity);
  EXPECT_DOUBLE_EQ(math::fifth_root(32.0 * 0x1p-1070), 0x1p-213);
}

/// FNV-1a hash.
class BitsHash {
 public:
  void add(double value) {
    std::uint64_t bits;
    std::memcpy(&bits, &value, sizeof bits);
    for (int byte = 0; byte < 8; ++byte)
      hash_ = (hash_ ^ (bits >> 8 * byte & 0xff)) * 0x100000001b3;
  }
  std::uint64_t value() const { return hash_; }

 private:
  std::uint64_t hash_ = 0xcbf29ce484222325;
};

// The hash was computed by GCC 12 on x86_64. Another value on another machine breaks the promise of
// equal bits for every scene.
TEST(Elementary, BitsAreTheSameOnEveryMachine) {
  Arguments draw;
  BitsHash hash;
  for (int i = 0; i < 100000; ++i) {
    const math::SineCosine at = math::sin_cos(draw.angle(i));
    const double x = draw.coordinate(i), y = draw.coordinate(i / 2), z = draw.coordinate(i / 4);
    for (const double value : {at.sine, at.cosine, math::atan2(y, x), math::hypot(x, y),
                               math::hypot(x, y, z), math::fifth_root(std::abs(z))})
      hash.add(value);
  }
  EXPECT_EQ(hash.value(), 0xb551634ef8f86130u);
}

TEST(Elementary, RotationVectorIsTheInverseOfRotation) {
  Random random;
  for (int i = 0; i < 1000; ++i) {
    const Vector3d axis = random.vector().normalized();
    for (const double angle : {0.0, 1e-200, 1e-9, 0.3, 2.0, kPi - 1e-6}) {
      const Vector3d w = angle * axis;
      // near half a turn the axis is known to the rounding of the cosine over its slope
      EXPECT_LE((rotation_vector(rotation(w)) - w).norm(), 8.0 * kEpsilon * angle) << angle;
    }
    // angles beyond half a turn are returned as the shorter rotation
    EXPECT_LE((rotation_vector(rotation((kPi + 0.5) * axis)) + (kPi - 0.5) * axis).norm(), 1e-14);
  }
}

TEST(Dense, SemidefiniteSystemsAreSolved) {
  Random random;
  for (int n = 1; n < 9; ++n) {
    for (int rank = 1; rank <= n; ++rank) {
      const MatrixXd B = MatrixXd::NullaryExpr(n, rank, [&] { return random.vector().x(); });
      const MatrixXd A = B * B.transpose();
      const VectorXd b = A * VectorXd::NullaryExpr(n, [&] { return random.vector().x(); });
      const VectorXd x = math::solve_semidefinite(A, b);
      ASSERT_TRUE(x.allFinite());
      // a singular matrix may have pivots of rounding, whose part of x is undetermined
      if (rank < n) continue;
      const double condition = A.norm() * dense_inverse(A).norm();
      EXPECT_LE((A * x - b).norm(), 1e-14 * condition * b.norm()) << n;
    }
  }
  MatrixXd A(3, 3);
  A << 4.0, 2.0, 0.0, 2.0, 1.0, 0.0, 0.0, 0.0, 0.0;  // pivots 4, 0, 0
  const VectorXd x = math::solve_semidefinite(A, Vector3d(8.0, 4.0, 0.0));
  EXPECT_TRUE((A * x).isApprox(VectorXd(Vector3d(8.0, 4.0, 0.0))));
  EXPECT_EQ(math::solve_semidefinite(MatrixXd(0, 0), VectorXd(0)).size(), 0);
}

TEST(Dense, EigensystemsOfSymmetricMatrices) {
  Random random;
  for (int i = 0; i < 1000; ++i) {
    const Matrix3d R = random.orientation().toRotationMatrix();
    const Vector3d size(1.0, i % 3 == 0 ? 0.5 : 1e-3, i % 2 == 0 ? 1e-2 : 0.0);
    const Matrix3d A = R * size.asDiagonal() * R.transpose();
    const Matrix3d symmetric = 0.5 * (A + A.transpose());
    const auto [values, vectors] = math::eigensystem(symmetric);
    // a few roundings of the largest entry
    EXPECT_LE((symmetric * vectors - vectors * values.asDiagonal()).norm(), 16.0 * kEpsilon);
    EXPECT_LE((vectors.transpose() * vectors - Matrix3d::Identity()).norm(), 16.0 * kEpsilon);
    EXPECT_NEAR(values.maxCoeff(), 1.0, 16.0 * kEpsilon);
  }
  EXPECT_TRUE(math::eigensystem(Matrix3d::Zero()).values.isZero(0.0));
  EXPECT_TRUE(math::eigensystem(Matrix3d::Identity()).vectors.isIdentity(0.0));
}

}  // namespace
}  // namespace constraint_sim::engine
