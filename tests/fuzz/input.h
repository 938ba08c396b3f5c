#ifndef TESTS_FUZZ_INPUT_H_
#define TESTS_FUZZ_INPUT_H_

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <type_traits>

/// What libFuzzer calls with each input; replay.cc calls it with every file of a corpus.
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size);

namespace fovea::fuzz {

/// Takes an input apart from its front. What is not there reads as zero or empty.
class Input {
 public:
  Input(const uint8_t* data, size_t size)
      : data_(reinterpret_cast<const char*>(data)), left_(size) {}

  template <typename T>
  T Number() {
    static_assert(std::is_arithmetic_v<T>);
    T value{};
    const size_t count = std::min(sizeof(T), left_);
    std::memcpy(&value, data_, count);
    Skip(count);
    return value;
  }
  std::string Bytes(size_t most) {
    const size_t count = std::min(most, left_);
    std::string bytes(data_, count);
    Skip(count);
    return bytes;
  }
  std::string Rest() { return Bytes(left_); }
  /// Up to the next `end`, which is skipped.
  std::string Until(char end) {
    const void* found = std::memchr(data_, end, left_);
    const size_t count =
        found == nullptr ? left_ : static_cast<size_t>(static_cast<const char*>(found) - data_);
    std::string bytes = Bytes(count);
    Skip(std::min<size_t>(1, left_));
    return bytes;
  }
  [[nodiscard]] bool empty() const { return left_ == 0; }

 private:
  void Skip(size_t count) {
    data_ += count;
    left_ -= count;
  }

  const char* data_;
  size_t left_;
};

/// Ends the process, which libFuzzer and ctest take note of.
inline void Require(bool holds) {
  if (!holds) {
    __builtin_trap();
  }
}

}  // namespace fovea::fuzz

#endif  // TESTS_FUZZ_INPUT_H_
