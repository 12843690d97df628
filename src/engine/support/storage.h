#pragma once

#include <memory>

namespace constraint_sim::engine {

/// Storage that steps use again. A copy of a world begins without it: no result depends on it.
template <class T>
class Storage {
 public:
  Storage() = default;
  Storage(const Storage& /*other*/) {}
  Storage(Storage&&) noexcept = default;
  Storage& operator=(const Storage& /*other*/) {
    of_.reset();
    return *this;
  }
  Storage& operator=(Storage&&) noexcept = default;
  ~Storage() = default;

  T* get() const { return of_.get(); }
  T* operator->() const { return of_.get(); }
  void make() {
    if (of_ == nullptr) of_ = std::make_shared<T>();
  }

 private:
  std::shared_ptr<T> of_;
};

}  // namespace constraint_sim::engine
