// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

namespace stgs {

// A value that its copies share until one of them changes it. One thread at a time for each copy.
template <typename T>
class Shared {
 public:
  const T& operator*() const { return *value_; }
  const T* operator->() const { return value_.get(); }
  // Returns the value for a change, which other copies do not see.
  T& edit() {
    if (value_.use_count() != 1) value_ = std::make_shared<T>(*value_);
    return *value_;
  }

 private:
  std::shared_ptr<T> value_ = std::make_shared<T>();
};

}  // namespace stgs
