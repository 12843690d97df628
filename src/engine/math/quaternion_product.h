#pragma once

// Products of quaternions on ARM in the order of sums that Eigen has on x86 in all versions, and on
// ARM from 3.4 on. Force-included by CMakeLists.txt (CONSTRAINT_SIM_SAME_BITS), before any code
// that multiplies quaternions.

#include <Eigen/Geometry>
#include <type_traits>

#if EIGEN_ARCH_ARM64 && !EIGEN_VERSION_AT_LEAST(3, 3, 90)

namespace Eigen {

template <class Q>
inline constexpr bool kIsQuaterniond =
    std::is_same_v<Q, Quaterniond> || std::is_same_v<Q, Map<Quaterniond>> ||
    std::is_same_v<Q, Map<const Quaterniond>>;

/// Preferred to the member of QuaternionBase, which would need conversions of its arguments.
template <class A, class B, class = std::enable_if_t<kIsQuaterniond<A> && kIsQuaterniond<B>>>
Quaterniond operator*(const A& a, const B& b) {
  return {(a.w() * b.w() - a.y() * b.y()) - (a.z() * b.z() + a.x() * b.x()),
          (a.w() * b.x() + a.y() * b.z()) - (a.z() * b.y() - a.x() * b.w()),
          (a.w() * b.y() + a.y() * b.w()) + (a.z() * b.x() - a.x() * b.z()),
          (a.w() * b.z() - a.y() * b.x()) + (a.z() * b.w() + a.x() * b.y())};
}

}  // namespace Eigen

#endif
