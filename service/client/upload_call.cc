#include "service/client/upload_call.h"

#include <algorithm>
#include <string>

#include "service/wire/status.h"
#include "service/wire/upload.h"

namespace fovea::client {
namespace {

/// Cuts the bytes of a step into messages.
class Pieces {
 public:
  Pieces(grpc::ClientWriter<v1::UploadStepRequest>& writer, const UploadSpec& spec)
      : writer_(writer), spec_(spec) {}

  [[nodiscard]] Status Send(std::span<const std::byte> bytes) {
    while (!bytes.empty()) {
      if (field_ == spec_.fields.size()) {
        return InvalidArgument("there are more bytes than {} x {} x {} voxels have", spec_.dims.x,
                               spec_.dims.y, spec_.dims.z);
      }
      const int64_t left = BytesOfField() - offset_;
      const int64_t count = std::min({std::ssize(bytes), left, wire::kUploadPieceBytes});
      v1::UploadPiece& piece = *message_.mutable_piece();
      piece.set_field(static_cast<uint32_t>(field_));
      piece.set_offset(static_cast<uint64_t>(offset_));
      piece.set_data(bytes.data(), static_cast<size_t>(count));
      if (!writer_.Write(message_)) {
        return Cancelled("the server wants no more");
      }
      bytes = bytes.subspan(static_cast<size_t>(count));
      offset_ += count;
      if (count == left) {
        ++field_;
        offset_ = 0;
      }
    }
    return absl::OkStatus();
  }

 private:
  [[nodiscard]] int64_t BytesOfField() const {
    return spec_.dims.Product() * wire::BytesOf(spec_.fields[field_].type);
  }

  grpc::ClientWriter<v1::UploadStepRequest>& writer_;
  const UploadSpec& spec_;
  v1::UploadStepRequest message_;  // used again: its bytes are allocated once
  size_t field_ = 0;
  int64_t offset_ = 0;
};

}  // namespace

StatusOr<UploadAnswer> CallUploadStep(v1::Ingest::Stub& stub,
                                      const std::function<void(grpc::ClientContext*)>& prepare,
                                      const UploadSpec& spec, const GiveVoxels& give) {
  grpc::ClientContext context;
  prepare(&context);
  v1::UploadStepResponse response;
  const auto writer = stub.UploadStep(&context, &response);
  v1::UploadStepRequest header;
  *header.mutable_header() = wire::ToProto(spec);
  Status given;
  bool over = !writer->Write(header);
  if (!over) {
    Pieces pieces(*writer, spec);
    given = give([&](std::span<const std::byte> bytes) {
      const Status sent = pieces.Send(bytes);
      over = over || absl::IsCancelled(sent);
      return sent;
    });
  }
  if (!given.ok() && !over) {
    context.TryCancel();
    static_cast<void>(writer->Finish());
    return given;
  }
  writer->WritesDone();
  const Status status = wire::FromGrpc(writer->Finish());
  if (wire::RetryDelayOf(status)) {  // a limit that is not reached for ever
    return MakeStatus(absl::StatusCode::kUnavailable, std::string(MessageOf(status)));
  }
  FOVEA_RETURN_IF_ERROR(status);
  return wire::FromProto(response);
}

}  // namespace fovea::client
