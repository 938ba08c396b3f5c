#include <sys/stat.h>

#include <filesystem>
#include <system_error>

#include "service/export/frame_provider.h"
#include "service/frames/frames.h"

namespace fovea::exports {
namespace {

class LocalProvider final : public FrameProvider {
 public:
  LocalProvider(std::shared_ptr<store::Dataset> dataset, std::string identity,
                frames::FrameSpec defaults, int threads)
      : dataset_(std::move(dataset)),
        info_(dataset_->info()),
        identity_(std::move(identity)),
        name_(std::filesystem::path(dataset_->path()).stem().string()),
        defaults_(std::move(defaults)),
        threads_(threads) {}

  [[nodiscard]] const std::string& identity() const override { return identity_; }
  [[nodiscard]] const store::DatasetInfo& info() const override { return info_; }

  StatusOr<std::vector<StepInfo>> Describe(const std::vector<int64_t>& steps) override {
    std::vector<StepInfo> described;
    for (const int64_t step : steps) {
      FOVEA_ASSIGN_OR_RETURN(const int64_t time_ns, dataset_->TimeNs(step));
      FOVEA_ASSIGN_OR_RETURN(const auto number, dataset_->FrameNumber(step));
      described.push_back({step, time_ns, number});
    }
    return described;
  }

  StatusOr<frames::FrameSpec> Resolve(const frames::FrameSpec& spec) override {
    return frames::ResolveSpec(*dataset_, spec, defaults_);
  }

  StatusOr<frames::Frame> Render(int64_t step, const frames::FrameSpec& spec) override {
    FOVEA_ASSIGN_OR_RETURN(const frames::FrameSpec resolved, Resolve(spec));
    return frames::RenderFrame(*dataset_, name_, step, resolved, threads_);
  }

  Status RenderEach(const std::vector<int64_t>& steps, const frames::FrameSpec& spec,
                    const std::function<Status(const frames::Frame&)>& on_frame) override {
    FOVEA_ASSIGN_OR_RETURN(const frames::FrameSpec resolved, Resolve(spec));
    for (size_t i = 0; i < steps.size(); ++i) {
      FOVEA_ASSIGN_OR_RETURN(frames::Frame frame,
                             frames::RenderFrame(*dataset_, name_, steps[i], resolved, threads_));
      frame.index = i;
      FOVEA_RETURN_IF_ERROR(on_frame(frame));
    }
    return absl::OkStatus();
  }

 private:
  std::shared_ptr<store::Dataset> dataset_;
  store::DatasetInfo info_;
  std::string identity_;
  std::string name_;
  frames::FrameSpec defaults_;
  int threads_;
};

}  // namespace

StatusOr<std::unique_ptr<FrameProvider>> OpenLocal(const std::string& path, int threads) {
  FOVEA_ASSIGN_OR_RETURN(auto dataset, store::Dataset::Open(path));
  FOVEA_ASSIGN_OR_RETURN(frames::FrameSpec defaults, frames::DefaultSpec(*dataset));
  std::error_code error;
  std::string identity = std::filesystem::weakly_canonical(path, error).string();
  // A dataset that was deleted and made again under its old name is another folder.
  if (struct stat folder{}; ::stat(path.c_str(), &folder) == 0) {
    identity += fmt::format("#{}", folder.st_ino);
  }
  return std::make_unique<LocalProvider>(std::move(dataset), std::move(identity),
                                         std::move(defaults), threads);
}

}  // namespace fovea::exports
