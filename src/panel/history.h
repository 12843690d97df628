#pragma once

#include <deque>
#include <vector>

namespace constraint_sim::panel {

/// Values during the last kSpan of wall time.
class History {
 public:
  static constexpr double kSpan = 60.0;  ///< [s]

  struct Point {
    double time;                 ///< wall time [s]
    std::vector<double> values;  ///< one for each line
  };

  void add(double time, std::vector<double> values) {
    points_.push_back({time, std::move(values)});
    while (points_.front().time < time - kSpan) points_.pop_front();
  }
  void clear() { points_.clear(); }
  const std::deque<Point>& points() const { return points_; }

 private:
  std::deque<Point> points_;
};

}  // namespace constraint_sim::panel
