// Transfer functions, as text and as JSON, and animations.

#include "engine/render/transfer_function.h"
#include "service/frames/animation.h"
#include "tests/fuzz/input.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace fovea;
  const std::string text(reinterpret_cast<const char*>(data), size);
  (void)render::ParseTransferFunction(text).ok();
  const auto animation = frames::Animation::Parse(text);
  if (animation.ok()) {
    const int64_t last = animation->frames() - 1;
    for (const int64_t frame : {int64_t{0}, last / 2, last}) {
      (void)animation->SpecAt(frame, {});
      (void)animation->StepAt(frame);
    }
  }
  return 0;
}
