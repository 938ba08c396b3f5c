#include "service/access/gate.h"

#include <algorithm>
#include <chrono>

#include "service/access/token_file.h"
#include "service/wire/status.h"

namespace fovea::access {
namespace {

constexpr std::string_view kScheme = "bearer ";
constexpr size_t kMaxTokenBytes = 4096;
constexpr auto kStreamRetry = std::chrono::seconds(1);

Status Unauthenticated(std::string_view message) {
  return MakeStatus(absl::StatusCode::kUnauthenticated, message);
}

/// The token of "Bearer TOKEN", the scheme in any case; empty if it is none.
std::string_view TokenOf(std::string_view authorization) {
  const auto same = [](char a, char b) {
    return (a >= 'A' && a <= 'Z' ? static_cast<char>(a - 'A' + 'a') : a) == b;
  };
  if (authorization.size() > kMaxTokenBytes || authorization.size() <= kScheme.size() ||
      !std::equal(kScheme.begin(), kScheme.end(), authorization.begin(),
                  [&](char scheme, char given) { return same(given, scheme); })) {
    return {};
  }
  return authorization.substr(kScheme.size());
}

Status OverQuota(const std::string& name, std::string_view limit, std::chrono::milliseconds wait) {
  return wire::WithRetry(
      wire::WithQuota(ResourceExhausted("token '{}' is above its quota of {}", name, limit),
                      "token:" + name, limit),
      wait);
}

}  // namespace

Caller::Caller(Token token)
    : token_(std::move(token)),
      pixels_(token_.quotas.pixels_per_second),
      bytes_in_(token_.quotas.bytes_in_per_second) {}

bool Caller::Sees(std::string_view dataset) const {
  return IsWithin(dataset, token_.prefix);
}

Status Caller::Check(Right right) const {
  if (right == Right::kWrite && token_.right != Right::kWrite) {
    return MakeStatus(
        absl::StatusCode::kPermissionDenied,
        fmt::format("token '{}' may read; this call needs one that may write", name()));
  }
  return absl::OkStatus();
}

Status Caller::TakePixels(int64_t pixels) {
  return Take(&pixels_, static_cast<double>(pixels), "pixels");
}

Status Caller::TakeBytesIn(int64_t bytes) {
  return Take(&bytes_in_, static_cast<double>(bytes), "bytes in");
}

StatusOr<std::chrono::milliseconds> Caller::SpendBytesIn(int64_t bytes) {
  FOVEA_RETURN_IF_ERROR(CheckRevoked());
  return bytes_in_.Spend(static_cast<double>(bytes));
}

Status Caller::Take(RateLimit* limit, double amount, std::string_view unit) {
  FOVEA_RETURN_IF_ERROR(CheckRevoked());
  if (const auto wait = limit->Take(amount)) {
    return OverQuota(name(), fmt::format("{:.10g} {} a second", limit->per_second(), unit), *wait);
  }
  return absl::OkStatus();
}

StatusOr<Caller::Stream> Caller::OpenStream(const std::shared_ptr<Caller>& caller) {
  FOVEA_RETURN_IF_ERROR(caller->CheckRevoked());
  const int64_t limit = caller->token_.quotas.streams;
  Stream stream(caller);
  if (++caller->streams_ > limit && limit > 0) {
    return OverQuota(caller->name(), fmt::format("{} streams at once", limit), kStreamRetry);
  }
  return stream;
}

Status Caller::CheckRevoked() const {
  return revoked_ ? Unavailable("token '{}' was changed or taken away; call again", name())
                  : absl::OkStatus();
}

StatusOr<std::unique_ptr<Gate>> Gate::Open(const std::string& token_file) {
  auto gate = std::unique_ptr<Gate>(new Gate(token_file));
  if (token_file.empty()) {
    Token everyone;
    everyone.right = Right::kWrite;
    gate->callers_ = std::make_shared<const Callers>(1, std::make_shared<Caller>(everyone));
  } else {
    FOVEA_RETURN_IF_ERROR(gate->Reload());
  }
  return gate;
}

Status Gate::Reload() {
  FOVEA_ASSIGN_OR_RETURN(const std::vector<Token> tokens, ReadTokenFile(token_file_));
  auto callers = std::make_shared<Callers>();
  const std::lock_guard lock(mutex_);
  const Callers before = callers_ == nullptr ? Callers() : *callers_;
  for (const Token& token : tokens) {
    const auto same = std::find_if(before.begin(), before.end(),
                                   [&](const auto& caller) { return caller->token() == token; });
    callers->push_back(same != before.end() ? *same : std::make_shared<Caller>(token));
  }
  for (const auto& caller : before) {
    if (std::find(callers->begin(), callers->end(), caller) == callers->end()) {
      caller->Revoke();
    }
  }
  callers_ = std::move(callers);
  return absl::OkStatus();
}

StatusOr<std::shared_ptr<Caller>> Gate::Identify(
    const std::vector<std::string_view>& authorization) const {
  std::shared_ptr<const Callers> callers;
  {
    const std::lock_guard lock(mutex_);
    callers = callers_;
  }
  if (!asks_for_tokens()) {
    return callers->front();
  }
  if (authorization.empty()) {
    return Unauthenticated(
        "this server asks for a token: send the metadata 'authorization: Bearer TOKEN' "
        "(--token-file)");
  }
  const std::string_view token = TokenOf(authorization.front());
  const Digest digest = DigestOf(token);
  std::shared_ptr<Caller> found;
  for (const auto& caller : *callers) {
    // All of them, always: the time says nothing about which.
    if (SameDigest(digest, caller->token().digest)) {
      found = caller;
    }
  }
  if (authorization.size() != 1 || token.empty() || found == nullptr) {
    return Unauthenticated("this server does not know the token that was sent");
  }
  return found;
}

size_t Gate::token_count() const {
  const std::lock_guard lock(mutex_);
  return asks_for_tokens() ? callers_->size() : 0;
}

}  // namespace fovea::access
