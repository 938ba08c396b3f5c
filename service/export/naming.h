#ifndef SERVICE_EXPORT_NAMING_H_
#define SERVICE_EXPORT_NAMING_H_

#include <cstdint>
#include <string>

#include "engine/base/status.h"

namespace fovea::exports {

/// The name of a numbered sequence: 'f.####.png' (one # a digit) or 'f.%04d.png'. Larger numbers
/// take more digits; negative ones have a sign before the digits.
class FramePattern {
 public:
  /// INVALID_ARGUMENT if the file's name (not its folder) has no such place, or more than one.
  [[nodiscard]] static StatusOr<FramePattern> Parse(const std::string& text);

  [[nodiscard]] std::string PathOf(int64_t number) const;
  /// The file's name without number and ending, for the manifest beside the frames: 'f'.
  [[nodiscard]] std::string Stem() const;
  [[nodiscard]] const std::string& text() const { return text_; }

 private:
  std::string text_;
  std::string before_, after_;
  int digits_ = 0;
};

}  // namespace fovea::exports

#endif  // SERVICE_EXPORT_NAMING_H_
