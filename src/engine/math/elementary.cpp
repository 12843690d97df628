// The polynomials of sine, cosine and arc tangent come from fdlibm (k_sin.c, k_cos.c, s_atan.c).
// The notice of fdlibm:
//
//   Copyright (C) 1993 by Sun Microsystems, Inc. All rights reserved.
//   Developed at SunPro, a Sun Microsystems, Inc. business.
//   Permission to use, copy, modify, and distribute this software is freely granted, provided that
//   this notice is preserved.

#include "engine/math/elementary.h"

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>

namespace constraint_sim::engine::math {
namespace {

constexpr double kQuarterPi = 0x1.921fb54442d18p-1;

// π/2 as a sum of two pieces of 33 bits, whose products with integers below 2²⁰ are exact, and a
// rest.
constexpr double kHalfPi1 = 0x1.921fb54400000p+0;
constexpr double kHalfPi2 = 0x1.0b4611a600000p-34;
constexpr double kHalfPi3 = 0x1.3198a2e037073p-69;
// π/2 as a double and its rounding error.
constexpr double kHalfPiHigh = 0x1.921fb54442d18p+0;
constexpr double kHalfPiLow = 0x1.1a62633145c07p-54;

// Binary digits of 2/π behind the point, in words of 32.
constexpr std::array<std::uint32_t, 40> kTwoOverPi{
    0xa2f9836eu, 0x4e441529u, 0xfc2757d1u, 0xf534ddc0u, 0xdb629599u, 0x3c439041u, 0xfe5163abu,
    0xdebbc561u, 0xb7246e3au, 0x424dd2e0u, 0x06492eeau, 0x09d1921cu, 0xfe1deb1cu, 0xb129a73eu,
    0xe88235f5u, 0x2ebb4484u, 0xe99c7026u, 0xb45f7e41u, 0x3991d639u, 0x835339f4u, 0x9c845f8bu,
    0xbdf9283bu, 0x1ff897ffu, 0xde05980fu, 0xef2f118bu, 0x5a0a6d1fu, 0x6d367ecfu, 0x27cb09b7u,
    0x4f463f66u, 0x9e5fea2du, 0x7527bac7u, 0xebe5f17bu, 0x3d0739f7u, 0x8a5292eau, 0x6bfb5fb1u,
    0x1f8d5d08u, 0x56033046u, 0xfc7b6babu, 0xf0cfbc20u, 0x9af4361du,
};

std::uint64_t bits_of(double x) {
  std::uint64_t bits;
  std::memcpy(&bits, &x, sizeof bits);
  return bits;
}

double from_bits(std::uint64_t bits) {
  double x;
  std::memcpy(&x, &bits, sizeof x);
  return x;
}

// Returns the upper 26 bits of the significand: products of two such numbers are exact.
double upper_half(double x) { return from_bits(bits_of(x) & 0xfffffffff8000000u); }

// Returns a b − product, exact up to an underflow or one bit of the product of both lower halves.
double product_error(double a, double b, double product) {
  const double a_high = upper_half(a), b_high = upper_half(b);
  const double a_low = a - a_high, b_low = b - b_high;
  return a_low * b_low - (((product - a_high * b_high) - a_low * b_high) - a_high * b_low);
}

// Angle x = quadrant π/2 + high + low, |high| ≤ π/4 up to rounding.
struct ReducedAngle {
  double high, low;
  int quadrant;
};

// Reduces an angle x [rad] of any finite size to its quadrant and a rest (Payne and Hanek, 1983).
// The product of x and 2/π is computed in integers, modulo 2³² and to 224 binary places, by as many
// digits of 2/π as the exponent of x needs.
ReducedAngle reduce_exactly(double x) {
  constexpr int kPlaces = 7;  // words behind the point
  constexpr std::uint64_t kWord = 0xffffffffu;
  const std::uint64_t bits = bits_of(x);
  const int exponent = static_cast<int>(bits >> 52 & 0x7ffu) - 1075;  // x = significand 2^exponent
  const std::uint64_t significand = (bits & 0xfffffffffffffu) | 0x10000000000000u;
  const int shift = exponent & 31, words = (exponent - shift) / 32;
  const std::array<std::uint64_t, 3> factor{significand << shift & kWord,
                                            significand >> (32 - shift) & kWord,
                                            shift == 0 ? 0u : significand >> (64 - shift)};

  std::array<std::uint32_t, kPlaces + 1> digits;  // last word: integer part
  std::uint64_t carry = 0;
  for (int place = 0; place <= kPlaces; ++place) {
    std::uint64_t low = carry & kWord, high = carry >> 32;
    for (int i = 0; i < 3; ++i) {
      const int word = i + words - 1 - (place - kPlaces);
      if (word < 0) continue;
      const std::uint64_t product =
          factor[static_cast<std::size_t>(i)] * kTwoOverPi[static_cast<std::size_t>(word)];
      low += product & kWord;
      high += product >> 32;
    }
    digits[static_cast<std::size_t>(place)] = static_cast<std::uint32_t>(low & kWord);
    carry = high + (low >> 32);
  }

  // Rounds to the nearest integer.
  std::uint32_t quadrant = digits[kPlaces];
  const bool is_below = digits[kPlaces - 1] >> 31 != 0;
  if (is_below) {
    ++quadrant;
    std::uint64_t borrow = 1;  // two's complement
    for (std::size_t place = 0; place < kPlaces; ++place) {
      const std::uint64_t sum = (~digits[place] & kWord) + borrow;
      digits[place] = static_cast<std::uint32_t>(sum & kWord);
      borrow = sum >> 32;
    }
  }

  // Leading words that are not zero, as high + low, to 2^-64 of high or better.
  std::size_t top = kPlaces - 1;
  double unit = 0x1p-32;
  for (; top > 3 && digits[top] == 0; --top) unit *= 0x1p-32;
  const double first = digits[top] * unit, second = digits[top - 1] * (unit * 0x1p-32);
  double high = first + second;
  double low = second - (high - first) +
               (digits[top - 2] * (unit * 0x1p-64) + digits[top - 3] * (unit * 0x1p-96));

  const double product = high * kHalfPiHigh;
  low = product_error(high, kHalfPiHigh, product) + (high * kHalfPiLow + low * kHalfPiHigh);
  high = product + low;
  low = product - high + low;
  const bool is_negative = bits >> 63 != 0;
  const int turns = static_cast<int>(quadrant & 3u);
  if (is_below != is_negative) high = -high, low = -low;
  return {high, low, is_negative ? -turns : turns};
}

// Reduces x [rad], |x| > π/4 up to rounding, by the method of Cody and Waite (1980) where that is
// exact enough.
ReducedAngle reduce(double x) {
  if (std::abs(x) < 0x1p20) {
    const double n = x * 0x1.45f306dc9c883p-1 + 0x1.8p52 - 0x1.8p52;  // nearest integer
    const double first = x - n * kHalfPi1;
    if (std::abs(first) > 0x1p-12) {  // larger than all terms still to be subtracted
      const double second = n * kHalfPi2;
      const double rest = first - second;
      const double third = n * kHalfPi3 - ((first - rest) - second);
      const double high = rest - third;
      return {high, (rest - high) - third, static_cast<int>(n)};
    }
  }
  return std::isfinite(x) ? reduce_exactly(x) : ReducedAngle{x - x, 0.0, 0};
}

constexpr double kS1 = -1.66666666666666324348e-01;

// Returns (sin x − x − kS1 x³)/x⁵ as a polynomial of z = x², |x| ≤ π/4.
double sine_series(double z) {
  constexpr double kS2 = 8.33333333332248946124e-03, kS3 = -1.98412698298579493134e-04,
                   kS4 = 2.75573137070700676789e-06, kS5 = -2.50507602534068634195e-08,
                   kS6 = 1.58969099521155010221e-10;
  return kS2 + z * (kS3 + z * kS4) + z * (z * z) * (kS5 + z * kS6);
}

// Returns sin(x), |x| ≤ π/4.
double sine_near_zero(double x) {
  const double z = x * x;
  return x + z * x * (kS1 + z * sine_series(z));
}

// Returns sin(high + low), |high| ≤ π/4.
double sine_near_zero(double high, double low) {
  const double z = high * high, cube = z * high;
  return high - ((z * (0.5 * low - cube * sine_series(z)) - low) - cube * kS1);
}

// Returns cos(high + low), |high| ≤ π/4.
double cosine_near_zero(double high, double low) {
  constexpr double kC1 = 4.16666666666666019037e-02, kC2 = -1.38888888888741095749e-03,
                   kC3 = 2.48015872894767294178e-05, kC4 = -2.75573143513906633035e-07,
                   kC5 = 2.08757232129817482790e-09, kC6 = -1.13596475577881948265e-11;
  const double z = high * high, w = z * z;
  const double r = z * (kC1 + z * (kC2 + z * kC3)) + w * w * (kC4 + z * (kC5 + z * kC6));
  const double half = 0.5 * z;
  const double one = 1.0 - half;
  return one + (((1.0 - one) - half) + (z * r - high * low));
}

bool is_own_sine(double x) { return std::abs(x) < 0x1p-27; }

// Angle that a small angle is added to, as a sum of two doubles [rad].
struct Origin {
  double high, low;
};

// Angles β, π/2 − β, π − β and π/2 + β for β = 0, atan ½ and π/4.
constexpr Origin kOrigins[3][4] = {
    {{0.0, 0.0},
     {0x1.921fb54442d18p+0, 0x1.1a62633145c07p-54},
     {0x1.921fb54442d18p+1, 0x1.1a62633145c07p-53},
     {0x1.921fb54442d18p+0, 0x1.1a62633145c07p-54}},
    {{0x1.dac670561bb4fp-2, 0x1.a2b7f222f65e2p-56},
     {0x1.1b6e192ebbe44p+0, 0x1.b1b466a88828ep-54},
     {0x1.56c6e7397f5aep+1, 0x1.660b64ece6f4bp-53},
     {0x1.0468a8ace4df6p+1, 0x1.0620bf7406affp-55}},
    {{0x1.921fb54442d18p-1, 0x1.1a62633145c07p-55},
     {0x1.921fb54442d18p-1, 0x1.1a62633145c07p-55},
     {0x1.2d97c7f3321d2p+1, 0x1.a79394c9e8a0ap-54},
     {0x1.2d97c7f3321d2p+1, 0x1.a79394c9e8a0ap-54}},
};

}  // namespace

double sin(double x) {
  if (is_own_sine(x)) return x;
  if (std::abs(x) <= kQuarterPi) return sine_near_zero(x);
  const ReducedAngle at = reduce(x);
  const double size =
      (at.quadrant & 1) != 0 ? cosine_near_zero(at.high, at.low) : sine_near_zero(at.high, at.low);
  return (at.quadrant & 2) != 0 ? -size : size;
}

double cos(double x) {
  if (std::abs(x) <= kQuarterPi) return cosine_near_zero(x, 0.0);
  const ReducedAngle at = reduce(x);
  const double size =
      (at.quadrant & 1) != 0 ? sine_near_zero(at.high, at.low) : cosine_near_zero(at.high, at.low);
  return ((at.quadrant + 1) & 2) != 0 ? -size : size;
}

SineCosine sin_cos(double x) {
  if (std::abs(x) <= kQuarterPi)
    return {is_own_sine(x) ? x : sine_near_zero(x), cosine_near_zero(x, 0.0)};
  const ReducedAngle at = reduce(x);
  double sine = sine_near_zero(at.high, at.low), cosine = cosine_near_zero(at.high, at.low);
  if ((at.quadrant & 1) != 0) {
    const double sine_of_rest = sine;
    sine = cosine;
    cosine = -sine_of_rest;
  }
  if ((at.quadrant & 2) != 0) {
    sine = -sine;
    cosine = -cosine;
  }
  return {sine, cosine};
}

// With the smaller coordinate n and the larger coordinate d, n/d = tan(β + δ) for the nearest β of
// 0, atan ½ and π/4. δ = atan t is small; by symmetry the angle is an Origin plus or minus δ.
double atan2(double y, double x) {
  if (std::isnan(x) || std::isnan(y)) return x + y;
  const bool is_left = std::signbit(x), is_steep = std::abs(y) > std::abs(x);
  double n = std::abs(is_steep ? x : y), d = std::abs(is_steep ? y : x);
  if (d > 0x1p1000 || d < 0x1p-900) {
    if (std::isinf(d)) {
      n = std::isinf(n) ? 1.0 : 0.0;
      d = 1.0;
    } else if (d == 0.0) {
      d = 1.0;
    } else {
      const double scale = d > 1.0 ? 0x1p-600 : 0x1p600;
      n *= scale;
      d *= scale;
    }
  }

  std::size_t nearest = 0;
  double t, correction = 0.0;
  if (n < 0.4375 * d) {
    t = n / d;
    if (t > 0x1p-27) {
      const double product = t * d;
      correction = ((n - product) - product_error(t, d, product)) / (d + t * t * d);
    }
  } else if (n < 0.6875 * d) {
    nearest = 1;
    t = (2.0 * n - d) / (2.0 * d + n);
  } else {
    nearest = 2;
    t = (n - d) / (n + d);
  }

  const double z = t * t, w = z * z;
  const double odd =
      z * (3.33333333333329318027e-01 +
           w * (1.42857142725034663711e-01 +
                w * (9.09088713343650656196e-02 +
                     w * (6.66107313738753120669e-02 +
                          w * (4.97687799461593236017e-02 + w * 1.62858201153657823623e-02)))));
  const double even =
      w * (-1.99999999998764832476e-01 +
           w * (-1.11111104054623557880e-01 +
                w * (-7.69187620504482999495e-02 +
                     w * (-5.83357013379057348645e-02 + w * -3.65315727442169155270e-02))));
  const double delta = t - (t * (odd + even) - correction);
  const Origin origin = kOrigins[nearest][(is_left ? 2 : 0) + (is_steep ? 1 : 0)];
  const double angle = origin.high + (origin.low + (is_left != is_steep ? -delta : delta));
  return std::signbit(y) ? -angle : angle;
}

double hypot(double x, double y) {
  const double square = x * x + y * y;
  if (square > 0x1p-960 && square < std::numeric_limits<double>::infinity())
    return std::sqrt(square);
  return hypot(x, y, 0.0);
}

double hypot(double x, double y, double z) {
  double square = x * x + y * y + z * z;
  if (square > 0x1p-960 && square < std::numeric_limits<double>::infinity())
    return std::sqrt(square);
  if (std::isinf(x) || std::isinf(y) || std::isinf(z))
    return std::numeric_limits<double>::infinity();
  const bool is_large = square > 1.0;
  const double scale = is_large ? 0x1p-600 : 0x1p600;
  x *= scale;
  y *= scale;
  z *= scale;
  square = x * x + y * y + z * z;
  return std::sqrt(square) * (is_large ? 0x1p600 : 0x1p-600);
}

// Newton's method from a fifth of the exponent, an estimate within 6 %.
double fifth_root(double x) {
  if (!(x > 0.0 && x < std::numeric_limits<double>::infinity())) return x;
  const bool is_subnormal = x < std::numeric_limits<double>::min();
  if (is_subnormal) x *= 0x1p60;
  double root = from_bits(bits_of(x) / 5 + 0x3325cccccccccc00u);
  for (int step = 0; step < 4; ++step) {
    const double square = root * root;
    root -= 0.2 * (root - x / (square * square));
  }
  return is_subnormal ? root * 0x1p-12 : root;
}

}  // namespace constraint_sim::engine::math
