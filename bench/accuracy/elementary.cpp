// Measures the largest errors of engine/math/elementary.h against MPFR, over arguments of all
// sizes. Fails where one exceeds the bound in the header. 1e8 arguments take two hours on one core:
//   g++ -std=c++17 -O2 -Isrc bench/accuracy/elementary.cpp src/engine/math/elementary.cpp
//     -ffp-contract=off -lmpfr -lgmp -pthread -o build/elementary_accuracy
//   build/elementary_accuracy 1e8

#include "engine/math/elementary.h"

#include <mpfr.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <random>
#include <thread>
#include <vector>

namespace math = constraint_sim::engine::math;

namespace {

constexpr mpfr_prec_t kBits = 140;  // precision of exact results

class Number {
 public:
  explicit Number(mpfr_prec_t bits) { mpfr_init2(value_, bits); }
  Number(const Number&) = delete;
  Number& operator=(const Number&) = delete;
  ~Number() { mpfr_clear(value_); }
  mpfr_ptr operator*() { return value_; }

 private:
  mpfr_t value_;
};

struct Function {
  const char* name;
  double stated;  // bound in the header [ulp]
};
constexpr std::array<Function, 6> kFunctions{{{"sin", 0.8},
                                              {"cos", 0.8},
                                              {"atan2", 1.0},
                                              {"hypot of 2", 1.25},
                                              {"hypot of 3", 1.6},
                                              {"fifth_root", 1.0}}};

/// Largest error of a function, and its arguments.
struct Worst {
  double error = 0.0;
  std::array<double, 3> at{};
};
using Errors = std::array<Worst, kFunctions.size()>;

double unit_in_last_place(double value) {
  int exponent = 0;
  std::frexp(value, &exponent);
  return std::ldexp(1.0, std::max(exponent, -1021) - 53);
}

class Measurement {
 public:
  Measurement(std::uint64_t seed, long arguments) : bits_(seed), arguments_(arguments) {}

  void run() {
    for (long i = 0; i < arguments_; ++i) {
      add_angle(draw_angle(i));
      const double a = draw_coordinate(i);
      add_coordinates(a, beside(a, i), beside(a, i / 3));
    }
  }
  const Errors& errors() const { return errors_; }

 private:
  double uniform(double least, double most) {
    return least + (most - least) * static_cast<double>(bits_() >> 11) * 0x1p-53;
  }
  double any() {
    for (;;) {
      const std::uint64_t bits = bits_();
      double x;
      std::memcpy(&x, &bits, sizeof x);
      if (std::isfinite(x)) return x;
    }
  }
  double draw_angle(long i) {
    switch (i % 6) {
      case 0:
        return uniform(-0.8, 0.8);
      case 1:
        return uniform(-10.0, 10.0);
      case 2:
        return uniform(-1e4, 1e4);
      case 3:
        return uniform(-2e6, 2e6);
      case 4:
        return any();
      default:  // multiples of π/2, and their neighbours
        return static_cast<double>(bits_() % 2000000) * 1.5707963267948966 *
               (1.0 + (static_cast<double>(bits_() % 5) - 2.0) * 0x1p-52);
    }
  }
  double draw_coordinate(long i) { return i % 2 == 0 ? uniform(-1.0, 1.0) : any(); }
  // Draws a number of the size of a, or of any size.
  double beside(double a, long i) {
    if (i % 5 == 0) return any();
    const double b = i % 3 == 0 ? uniform(-1.0, 1.0) : a * std::exp2(uniform(-30.0, 30.0));
    return std::isfinite(b) ? b : 1.0;
  }

  void add(std::size_t function, double got, Number* exact, std::array<double, 3> at) {
    const double nearest = mpfr_get_d(**exact, MPFR_RNDN);
    if (!std::isfinite(nearest)) return;
    mpfr_sub_d(*difference_, **exact, got, MPFR_RNDN);
    const double error =
        std::abs(mpfr_get_d(*difference_, MPFR_RNDN)) / unit_in_last_place(nearest);
    if (!(error <= errors_[function].error)) errors_[function] = {error, at};
  }

  void add_angle(double x) {
    mpfr_set_d(*x_, x, MPFR_RNDN);
    mpfr_sin_cos(*exact_, *exact_2_, *x_, MPFR_RNDN);
    add(0, math::sin(x), &exact_, {x});
    add(1, math::cos(x), &exact_2_, {x});
  }

  void add_coordinates(double a, double b, double c) {
    mpfr_set_d(*x_, a, MPFR_RNDN);
    mpfr_set_d(*y_, b, MPFR_RNDN);
    mpfr_atan2(*exact_, *y_, *x_, MPFR_RNDN);
    if (std::abs(mpfr_get_d(*exact_, MPFR_RNDN)) >= 0x1p-1022)
      add(2, math::atan2(b, a), &exact_, {b, a});
    mpfr_hypot(*exact_, *x_, *y_, MPFR_RNDN);
    add(3, math::hypot(a, b), &exact_, {a, b});
    mpfr_set_d(*y_, c, MPFR_RNDN);
    mpfr_hypot(*exact_2_, *exact_, *y_, MPFR_RNDN);
    add(4, math::hypot(a, b, c), &exact_2_, {a, b, c});
    mpfr_abs(*x_, *x_, MPFR_RNDN);
    mpfr_rootn_ui(*exact_, *x_, 5, MPFR_RNDN);
    add(5, math::fifth_root(std::abs(a)), &exact_, {a});
  }

  std::mt19937_64 bits_;
  long arguments_;
  Errors errors_{};
  Number x_{53}, y_{53}, exact_{kBits}, exact_2_{kBits}, difference_{kBits};
};

}  // namespace

int main(int argc, char** argv) {
  const double arguments = argc > 1 ? std::atof(argv[1]) : 1e6;
  if (!(arguments >= 1.0 && arguments <= 1e12)) {
    std::fprintf(stderr, "elementary_accuracy: arguments: must be 1 to 1e12, got %s\n", argv[1]);
    return 2;
  }
  const unsigned threads = std::max(1u, std::thread::hardware_concurrency());
  std::vector<Errors> of_thread(threads);
  std::vector<std::thread> running;
  for (unsigned i = 0; i < threads; ++i)
    running.emplace_back([&, i] {
      Measurement measurement(i + 1, static_cast<long>(std::ceil(arguments / threads)));
      measurement.run();
      of_thread[i] = measurement.errors();
      mpfr_free_cache();
    });
  for (std::thread& thread : running) thread.join();

  bool is_as_stated = true;
  std::printf("%.0e arguments\n%-12s %8s %8s [ulp]  of\n", arguments, "", "largest", "stated");
  for (std::size_t f = 0; f < kFunctions.size(); ++f) {
    Worst worst;
    for (const Errors& errors : of_thread)
      if (!(errors[f].error <= worst.error)) worst = errors[f];
    std::printf("%-12s %8.4f %8.2f        %.17g %.17g %.17g\n", kFunctions[f].name, worst.error,
                kFunctions[f].stated, worst.at[0], worst.at[1], worst.at[2]);
    is_as_stated = is_as_stated && worst.error < kFunctions[f].stated;
  }
  return is_as_stated ? 0 : 1;
}
