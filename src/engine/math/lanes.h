#pragma once

#include <Eigen/Core>

namespace constraint_sim::engine {

/// Two numbers that go through equal arithmetic side by side, in one register where the processor
/// has vectors. Each operation rounds as for scalars. A scalar type for Eigen.
class Lanes {
  using Values = double __attribute__((vector_size(16)));

 public:
  /// Result of a comparison: all bits of a number are set where it holds.
  using Mask = decltype(Values{} > Values{});

  Lanes() = default;
  Lanes(double both) : values_{both, both} {}  // NOLINT: Eigen makes scalars from numbers
  Lanes(double first, double second) : values_{first, second} {}

  double first() const { return values_[0]; }
  double second() const { return values_[1]; }
  Lanes swapped() const { return {second(), first()}; }

  Lanes operator-() const { return Lanes(-values_); }
  friend Lanes operator+(Lanes a, Lanes b) { return Lanes(a.values_ + b.values_); }
  friend Lanes operator-(Lanes a, Lanes b) { return Lanes(a.values_ - b.values_); }
  friend Lanes operator*(Lanes a, Lanes b) { return Lanes(a.values_ * b.values_); }
  friend Lanes operator/(Lanes a, Lanes b) { return Lanes(a.values_ / b.values_); }
  Lanes& operator+=(Lanes b) { return *this = *this + b; }
  Lanes& operator-=(Lanes b) { return *this = *this - b; }
  Lanes& operator*=(Lanes b) { return *this = *this * b; }
  friend Mask operator>(Lanes a, Lanes b) { return a.values_ > b.values_; }

 private:
  explicit Lanes(Values values) : values_(values) {}

  Values values_;
};

using Lanes3 = Eigen::Matrix<Lanes, 3, 1>;
using Lanes33 = Eigen::Matrix<Lanes, 3, 3>;

/// Returns lanes with `a` first and `b` second, for each entry.
template <int kRows, int kColumns>
Eigen::Matrix<Lanes, kRows, kColumns> join(const Eigen::Matrix<Lanes, kRows, kColumns>& a,
                                           const Eigen::Matrix<Lanes, kRows, kColumns>& b) {
  return a.binaryExpr(b, [](Lanes x, Lanes y) { return Lanes(x.first(), y.second()); });
}

template <int kRows, int kColumns>
Eigen::Matrix<Lanes, kRows, kColumns> swapped(const Eigen::Matrix<Lanes, kRows, kColumns>& a) {
  return a.unaryExpr([](Lanes x) { return x.swapped(); });
}

}  // namespace constraint_sim::engine

namespace Eigen {

template <>
struct NumTraits<constraint_sim::engine::Lanes> : NumTraits<double> {
  using Real = constraint_sim::engine::Lanes;
  using NonInteger = constraint_sim::engine::Lanes;
  using Literal = constraint_sim::engine::Lanes;
  using Nested = constraint_sim::engine::Lanes;
};

}  // namespace Eigen
