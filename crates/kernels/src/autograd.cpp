// Puts a function whose gradient is computed elsewhere into libtorch's autograd graph.

#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

#include <torch/csrc/autograd/function.h>
#include <torch/csrc/autograd/functions/utils.h>
#include <torch/csrc/autograd/variable.h>

using at::Tensor;
using torch::autograd::variable_list;

namespace {

// Bytes of the text that says why a gradient failed.
constexpr size_t REASON = 256;

struct Calls {
  // Fills `results`, one new tensor for each input; false if that failed, and then `reason`.
  bool (*backward)(void *state, const Tensor *gradient, Tensor **results, char *reason);
  void (*release)(void *state);
};

struct ForeignFunction : torch::autograd::Node {
  ForeignFunction(size_t inputs, void *state, Calls calls) : inputs(inputs), state(state), calls(calls) {}
  ~ForeignFunction() override { release_variables(); }

  std::string name() const override { return "paig"; }

  variable_list apply(variable_list &&gradients) override {
    // With create_graph: what is computed outside libtorch would be missing in the second derivatives, silently.
    TORCH_CHECK(!at::GradMode::is_enabled(), "the kernels have no second derivatives; take model.kernels=\"libtorch\"");
    std::lock_guard<std::mutex> lock(mutex_);
    variable_list results(inputs);
    if (!gradients[0].defined()) return results;
    TORCH_CHECK(state != nullptr, "the gradient of this function was computed before, and what it needs is freed");
    std::vector<Tensor *> raw(inputs, nullptr);
    char reason[REASON] = {};
    bool done = calls.backward(state, &gradients[0], raw.data(), reason);
    for (size_t i = 0; i < inputs; i++) {
      std::unique_ptr<Tensor> owned(raw[i]);
      if (owned) results[i] = *owned;
    }
    TORCH_CHECK(done, "a kernel's gradient failed: ", reason);
    return results;
  }

  void release_variables() override {
    std::lock_guard<std::mutex> lock(mutex_);
    if (state != nullptr) calls.release(state);
    state = nullptr;
  }

  size_t inputs;
  void *state;
  Calls calls;
};

}  // namespace

extern "C" {

// Whether a function of these inputs has to remember how its gradient is computed.
bool paig_records(const Tensor *const *inputs, size_t count) {
  if (!at::GradMode::is_enabled()) return false;
  for (size_t i = 0; i < count; i++)
    if (inputs[i]->requires_grad()) return true;
  return false;
}

// A variable without a gradient keeps the next one as it is, unless others have it, too, or it lies otherwise in memory; one that
// has a gradient adds to it.
void paig_forget_gradient(const Tensor *variable) { variable->mutable_grad().reset(); }

// Makes `output` a function of the inputs. Takes over `state`, whatever happens; false if it failed.
bool paig_attach(Tensor *output, const Tensor *const *inputs, size_t count, void *state, Calls calls) {
  try {
    std::shared_ptr<ForeignFunction> node(new ForeignFunction(count, state, calls), torch::autograd::deleteNode);
    variable_list variables;
    for (size_t i = 0; i < count; i++) variables.push_back(*inputs[i]);
    node->set_next_edges(torch::autograd::collect_next_edges(variables));
    torch::autograd::set_history(*output, node);
    return true;
  } catch (const std::exception &) {
    return false;
  }
}

}
