#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>

#include "engine/math/numbers.h"

namespace constraint_sim::sensors {

/// Gaussian noise as a function of seed, sample and channel. It has no memory, so a run that is
/// repeated, or continued from a snapshot, has equal noise.
class Noise {
 public:
  explicit Noise(std::uint64_t seed) : seed_(seed) {}

  /// Three numbers of mean 0 and standard deviation 1, for channels of 3, 6, ...
  Eigen::Vector3d vector(std::uint64_t sample, std::uint64_t channel) const {
    return {number(sample, channel), number(sample, channel + 1), number(sample, channel + 2)};
  }

  /// A number of mean 0 and standard deviation 1 (Box and Muller 1958).
  double number(std::uint64_t sample, std::uint64_t channel) const {
    const std::uint64_t key = mixed(mixed(seed_ ^ mixed(sample)) + channel);
    return std::sqrt(-2.0 * std::log(uniform(key))) *
           std::cos(2.0 * engine::kPi * uniform(mixed(key)));
  }

 private:
  // SplitMix64 (Steele, Lea and Flood 2014), a bijection that spreads neighbours.
  static std::uint64_t mixed(std::uint64_t x) {
    x += 0x9e3779b97f4a7c15u;
    x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
    x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
    return x ^ (x >> 31);
  }
  static double uniform(std::uint64_t bits) {  // (0, 1]
    return (static_cast<double>(bits >> 11) + 1.0) * 0x1p-53;
  }

  std::uint64_t seed_;
};

}  // namespace constraint_sim::sensors
