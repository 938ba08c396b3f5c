#include "tests/unit/service/server/wrong_requests.h"

#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <random>
#include <utility>

#include <google/protobuf/reflection.h>

namespace fovea::server {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

bool IsNumber(const FieldDescriptor& field) {
  return field.cpp_type() != FieldDescriptor::CPPTYPE_STRING &&
         field.cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE &&
         field.cpp_type() != FieldDescriptor::CPPTYPE_BOOL;
}

/// Sets a number to the nearest that the field can hold; whether it is the very one.
bool SetNumber(Message* message, const FieldDescriptor& field, double value) {
  const auto* to = message->GetReflection();
  const auto fits = [&](double low, double high) {
    return value >= low && value < high && value == std::floor(value);
  };
  switch (field.cpp_type()) {
    case FieldDescriptor::CPPTYPE_DOUBLE:
      to->SetDouble(message, &field, value);
      return true;
    case FieldDescriptor::CPPTYPE_FLOAT:
      to->SetFloat(message, &field, static_cast<float>(value));
      return true;
    case FieldDescriptor::CPPTYPE_UINT32:
      return fits(0, 4294967296.0) &&
             (to->SetUInt32(message, &field, static_cast<uint32_t>(value)), true);
    case FieldDescriptor::CPPTYPE_UINT64:
      return fits(0, kMost64) &&
             (to->SetUInt64(message, &field, static_cast<uint64_t>(value)), true);
    case FieldDescriptor::CPPTYPE_INT64:
      return fits(-kMost64 / 2, kMost64 / 2) &&
             (to->SetInt64(message, &field, static_cast<int64_t>(value)), true);
    case FieldDescriptor::CPPTYPE_ENUM:
      return fits(-2147483648.0, 2147483648.0) &&
             (to->SetEnumValue(message, &field, static_cast<int>(value)), true);
    default:
      return false;
  }
}

/// Changes the field of one message so that the request is wrong.
using Spoil = std::function<bool(Message*, const FieldDescriptor*)>;

Spoil Number(double value) {
  return [value](Message* message, const FieldDescriptor* field) {
    return SetNumber(message, *field, value);
  };
}
Spoil Text(std::string text, bool in_list = false) {
  return [text = std::move(text), in_list](Message* message, const FieldDescriptor* field) {
    if (in_list) {
      message->GetReflection()->SetRepeatedString(message, field, 0, text);
    } else {
      message->GetReflection()->SetString(message, field, text);
    }
    return true;
  };
}

class Spoilers {
 public:
  explicit Spoilers(const Rule& rule, const FieldDescriptor& field) : rule_(rule), field_(field) {}

  std::vector<Spoil> All(std::mt19937_64& random) {
    switch (rule_.is) {
      case Is::kAny:
        break;
      case Is::kRange:
        AddRange(random);
        break;
      case Is::kAbove:
        AddNotFinite();
        AddNumbers(
            {rule_.low, rule_.low - 1, rule_.low - 1e6, -1e300, std::nextafter(rule_.low, -1e300)});
        break;
      case Is::kFinite:
        AddNotFinite();
        break;
      case Is::kEnum:
        AddNumbers({6, 42, -1, 2147483647, -2147483648.0});
        AddNumbers({static_cast<double>(7 + random() % 1'000'000)});
        break;
      case Is::kCount:
        AddCounts(random);
        break;
      case Is::kNeeded:
        all_.push_back([](Message* message, const FieldDescriptor* field) {
          message->GetReflection()->ClearField(message, field);
          return true;
        });
        break;
      case Is::kStep:
        AddNumbers({rule_.high, rule_.high + 1, 1e6, 4294967296.0, 9223372036854775808.0,
                    18446744073709549568.0,
                    rule_.high + static_cast<double>(random() % 1'000'000)});
        break;
      case Is::kTime:
        AddNumbers({-9223372036854775808.0, -1, -1e18,
                    -static_cast<double>(random() % 1'000'000'000) - 1});
        break;
      case Is::kName:
      case Is::kNewName:
      case Is::kFile:
        AddNames();
        break;
      case Is::kWord:
        AddWords();
        break;
      case Is::kText:
        all_.push_back(Text(std::string(static_cast<size_t>(rule_.high) + 1, 'x')));
        all_.push_back(Text(std::string(100'000, 'x')));
        break;
      case Is::kPowerOf2:
        AddNumbers({0, 3, 5, 255, 257, 512, 4294967295.0});
        break;
    }
    return std::move(all_);
  }

 private:
  void AddNumbers(std::initializer_list<double> values) {
    for (const double value : values) {
      all_.push_back(Number(value));
    }
  }
  void AddNotFinite() {
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    AddNumbers({std::nan(""), -std::nan(""), kInfinity, -kInfinity});
  }
  void AddRange(std::mt19937_64& random) {
    const double low = rule_.low, high = rule_.high;
    const double part = std::uniform_real_distribution<double>(0, 1)(random);
    if (field_.cpp_type() == FieldDescriptor::CPPTYPE_DOUBLE ||
        field_.cpp_type() == FieldDescriptor::CPPTYPE_FLOAT) {
      const bool is_float = field_.cpp_type() == FieldDescriptor::CPPTYPE_FLOAT;
      const auto beyond = [&](double from, double to) {
        return is_float ? std::nextafter(static_cast<float>(from), static_cast<float>(to))
                        : std::nextafter(from, to);
      };
      AddNotFinite();
      if (low > -kMost64) {
        AddNumbers({beyond(low, -1e30), low - 1, low - 1e6 * (1 + std::abs(low)) * part, -1e300});
      }
      if (high < kMost64) {
        AddNumbers({beyond(high, 1e38), high * 2 + 1, high + 1e6 * (1 + high) * part, 1e300});
      }
      return;
    }
    AddNumbers({low - 1, -1, high + 1, high + 2, 2 * high + 1, 65537, 4294967295.0, 1e15,
                18446744073709549568.0, high + std::floor(1e6 * part)});
  }
  void AddCounts(std::mt19937_64& random) {
    const auto low = static_cast<int>(rule_.low), high = static_cast<int>(rule_.high);
    for (const int count : {low - 1, 0, high + 1, high + 2, 2 * high + 1, 3 * high + 3,
                            high + 1 + static_cast<int>(random() % 1000)}) {
      if (count < 0 || (count >= low && count <= high)) {
        continue;
      }
      // A list of places may be left out.
      if (count == 0 && (field_.full_name() == "fovea.v1.ReadingBatch.y" ||
                         field_.full_name() == "fovea.v1.ReadingBatch.z")) {
        continue;
      }
      all_.push_back([count](Message* message, const FieldDescriptor* field) {
        Resize(message, field, count);
        return true;
      });
    }
  }
  /// Repeats the first element.
  static void Resize(Message* message, const FieldDescriptor* field, int count) {
    const auto* to = message->GetReflection();
    while (to->FieldSize(*message, field) > count) {
      to->RemoveLast(message, field);
    }
    while (to->FieldSize(*message, field) < count) {
      switch (field->cpp_type()) {
        case FieldDescriptor::CPPTYPE_MESSAGE: {
          Message* added = to->AddMessage(message, field);
          added->CopyFrom(to->GetRepeatedMessage(*message, field, 0));
          break;
        }
        case FieldDescriptor::CPPTYPE_STRING:
          to->AddString(message, field, "n" + std::to_string(to->FieldSize(*message, field)));
          break;
        case FieldDescriptor::CPPTYPE_DOUBLE:
          to->AddDouble(message, field, 2);
          break;
        case FieldDescriptor::CPPTYPE_FLOAT:
          to->AddFloat(message, field, 2);
          break;
        case FieldDescriptor::CPPTYPE_INT64:
          to->AddInt64(message, field, 1'100'000'000);
          break;
        default:
          to->AddUInt64(message, field, 1);
      }
    }
  }
  void AddNames() {
    const bool may_be_new = rule_.is == Is::kNewName || rule_.is == Is::kFile;
    for (const char* name :
         {"..", "../plume", "a/../plume", "/etc/passwd", "plume/", "//", ".", "plume\n"}) {
      all_.push_back(Text(name, field_.is_repeated()));
    }
    for (const char* name :
         {"no-such", "plume.zarr", "PLUME", " plume", "\xE2\x80\xAE", "%s%n", "~", "-", "*"}) {
      if (!may_be_new) {
        all_.push_back(Text(name, field_.is_repeated()));
      }
    }
    all_.push_back(Text(std::string("plume\0x", 7), field_.is_repeated()));
    all_.push_back(Text(std::string(5000, 'x'), field_.is_repeated()));
    all_.push_back(Text(std::string(200'000, '/'), field_.is_repeated()));
    all_.push_back(Text("", field_.is_repeated()));
  }
  void AddWords() {
    if (IsNumber(field_)) {
      AddNumbers({0, 1, 7, 9, 15, 17, 31, 33, 64, 4294967295.0});
      return;
    }
    for (const char* word : {"x", "0123456789 abcdef", "\n", "\xE2\x80\xAE", "..", "0x0x0:uint8",
                             "1e9", "16x16x16:uint9", "16x16x-1:uint8", "99999999x1x1:uint8",
                             "{\"frames\": -1, \"keys\": []}", "[[[[[[[[", "{}", "null",
                             "{\"frames\": 1e99, \"keys\": [{\"frame\": 0}]}"}) {
      all_.push_back(Text(word));
    }
    all_.push_back(Text(std::string(600'000, '[')));
    all_.push_back(Text(std::string("haar\0", 5)));
  }

  const Rule& rule_;
  const FieldDescriptor& field_;
  std::vector<Spoil> all_;
};

/// Whether this number is within the rule's range after all: then nothing is wrong with it.
bool IsRight(const Rule& rule, const Message& message, const FieldDescriptor& field) {
  if (rule.is != Is::kRange || field.is_repeated() || !IsNumber(field)) {
    return false;
  }
  const auto* of = message.GetReflection();
  const double value =
      field.cpp_type() == FieldDescriptor::CPPTYPE_UINT32 ? of->GetUInt32(message, &field)
      : field.cpp_type() == FieldDescriptor::CPPTYPE_UINT64
          ? static_cast<double>(of->GetUInt64(message, &field))
      : field.cpp_type() == FieldDescriptor::CPPTYPE_FLOAT  ? of->GetFloat(message, &field)
      : field.cpp_type() == FieldDescriptor::CPPTYPE_DOUBLE ? of->GetDouble(message, &field)
                                                            : std::nan("");
  return value >= rule.low && value <= rule.high;
}

class Generator {
 public:
  /// All that can be wrong with the last message of `good`.
  void Add(const GoodRequest& good) {
    good_ = &good;
    root_.reset(good.messages.back()->New());
    root_->CopyFrom(*good.messages.back());
    Walk(root_.get(), "");
  }
  [[nodiscard]] WrongRequests Take() { return std::move(made_); }

 private:
  void Walk(Message* message, const std::string& prefix) {
    std::vector<const FieldDescriptor*> fields;
    message->GetReflection()->ListFields(*message, &fields);
    for (const FieldDescriptor* field : fields) {
      const std::string path = prefix + field->name();
      AddField(message, field, path);
      if (field->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE) {
        continue;
      }
      if (!field->is_repeated()) {
        Walk(message->GetReflection()->MutableMessage(message, field), path + ".");
      }
      for (int i = 0;
           field->is_repeated() && i < message->GetReflection()->FieldSize(*message, field); ++i) {
        Walk(message->GetReflection()->MutableRepeatedMessage(message, field, i),
             path + "[" + std::to_string(i) + "].");
      }
    }
  }

  void AddField(Message* message, const FieldDescriptor* field, const std::string& path) {
    const std::string& method = good_->method->name();
    made_.fields.insert(method + ":" + WithoutIndices(path));
    const Rule* rule = RuleOf(method, WithoutIndices(path));
    if (rule == nullptr) {
      if (field->message_type() == nullptr) {
        made_.no_rule.insert(method + ":" + path);
      }
      return;
    }
    const std::unique_ptr<Message> before(message->New());
    before->CopyFrom(*message);
    for (const Spoil& spoil : Spoilers(*rule, *field).All(random_)) {
      if (spoil(message, field) && !IsRight(*rule, *message, *field)) {
        Wrong wrong;
        wrong.call.method = good_->Path();
        wrong.path = path;
        wrong.rule = rule;
        for (size_t i = 0; i + 1 < good_->messages.size(); ++i) {
          wrong.call.messages.push_back(good_->messages[i]->SerializeAsString());
        }
        wrong.call.messages.push_back(root_->SerializeAsString());
        wrong.call.most_replies = 10;  // to the messages before
        made_.all.push_back(std::move(wrong));
      }
      message->CopyFrom(*before);
    }
  }

  std::mt19937_64 random_{20};
  const GoodRequest* good_ = nullptr;
  std::unique_ptr<Message> root_;
  WrongRequests made_;
};

}  // namespace

WrongRequests MakeWrongRequests(const std::vector<GoodRequest>& good) {
  Generator generator;
  for (const GoodRequest& request : good) {
    generator.Add(request);
  }
  return generator.Take();
}

std::string WithoutIndices(const std::string& path) {
  std::string text;
  for (const char c : path) {
    text += c >= '0' && c <= '9' && text.ends_with('[') ? "" : std::string(1, c);
  }
  return text;
}

}  // namespace fovea::server
