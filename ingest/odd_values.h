#ifndef INGEST_ODD_VALUES_H_
#define INGEST_ODD_VALUES_H_

#include <cstdint>
#include <string>
#include <vector>

namespace fovea::ingest {

/// Values of a series that could not be kept as they are, by field, and where each kind came first.
class OddValues {
 public:
  OddValues() = default;
  explicit OddValues(const std::vector<std::string>& fields);

  /// `nonfinite`: NaN or infinite, made the background; `rounded`: not exact in float32.
  void Count(size_t field, const std::string& path, uint64_t nonfinite, uint64_t rounded);

  [[nodiscard]] uint64_t NonfiniteValues() const;
  /// One line for each kind and field that there is.
  [[nodiscard]] std::vector<std::string> Warnings() const;

 private:
  struct Tally {
    uint64_t values = 0;
    std::string first_path;
    void Add(uint64_t count, const std::string& path);
  };
  struct OfField {
    std::string name;
    Tally nonfinite, rounded;
  };
  std::vector<OfField> fields_;
};

}  // namespace fovea::ingest

#endif  // INGEST_ODD_VALUES_H_
