// A value that is made when it is first asked for.
//
// Movable, not copyable. Get is thread-safe; the first call makes the value, others wait for it.
#pragma once

#include <memory>
#include <mutex>
#include <optional>

namespace carmap {

template <typename T>
class Lazy {
 public:
  /// `make` gives the value, and must give the same one whenever it is called.
  template <typename Make>
  const T& Get(Make&& make) const {
    std::call_once(state_->once, [&] { state_->value.emplace(make()); });
    return *state_->value;
  }

 private:
  struct State {
    std::once_flag once;
    std::optional<T> value;
  };
  std::unique_ptr<State> state_ = std::make_unique<State>();
};

}  // namespace carmap
