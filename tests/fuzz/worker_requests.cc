// What the worker decodes: requests come from the program, but a decoder that crashes is a bug.

#include "ingest/protocol.h"
#include "tests/fuzz/input.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace fovea::ingest;
  fovea::fuzz::Input input(data, size);
  const auto kind = static_cast<FrameKind>(input.Number<uint8_t>());
  const std::string payload = input.Rest();
  const FrameView frame{kind, payload};
  if (const auto scan = DecodeScanRequest(frame); scan.ok()) {
    fovea::fuzz::Require(DecodeScanRequest(Encode(*scan)).ok());
  }
  if (const auto read = DecodeReadRequest(frame); read.ok()) {
    fovea::fuzz::Require(DecodeReadRequest(Encode(*read)).ok());
  }
  if (const auto picture = DecodePictureRequest(frame); picture.ok()) {
    fovea::fuzz::Require(DecodePictureRequest(Encode(*picture)).ok());
  }
  if (const auto files = DecodeFiles(frame); files.ok()) {
    size_t count = 0;
    for (const Frame& again : EncodeFiles(*files)) {
      count += DecodeFiles(again)->size();
    }
    fovea::fuzz::Require(count == files->size());
  }
  (void)DecodeBeginRequest(frame).ok();
  (void)Printable(payload);
  return 0;
}
