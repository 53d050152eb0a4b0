#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares STGS's perceptual loss and its gradient with PyTorch's, on networks of random weights.

usage: compare_networks.py PERCEPTUAL_PROBE [cpu] [cuda] [cuda-float]

PyTorch computes in double, from torchvision's own VGG16, SqueezeNet and AlexNet. Exit code 0: every
relative error is within its bound; 1: one is not; 77: PyTorch, torchvision or safetensors is
missing.
"""
import copy
import os
import statistics
import subprocess
import sys
import tempfile

try:
    import torch
    import torchvision
    from safetensors.torch import save_file
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

# Bounds of the relative errors: of the loss; of the gradient (norm of the difference), median over
# the image pairs; of the gradient, largest. The gradient is discontinuous where a feature crosses
# zero or two inputs of a pooling are equal, so rounding can flip the gradient of a few features.
# TF32 (cuda) keeps 10 bits of each factor and flips several; SqueezeNet, which is deepest, loses
# most.
EXACT = (1e-5, 1e-3, 1e-2)
BOUNDS = {"vgg": {"cpu": EXACT, "cuda-float": EXACT, "cuda": (1e-3, 8e-2, 0.15)},
          "squeeze": {"cpu": EXACT, "cuda-float": EXACT, "cuda": (3e-3, 8e-2, 0.15)},
          "alex": {"cpu": EXACT, "cuda-float": EXACT, "cuda": (1e-3, 8e-2, 0.15)}}
# By torchvision's index of the layer whose output is compared: its channels.
TAPS = {"vgg": {3: 64, 8: 128, 15: 256, 22: 512, 29: 512},
        "squeeze": {1: 64, 4: 128, 7: 256, 9: 384, 10: 384, 11: 512, 12: 512},
        "alex": {1: 64, 4: 192, 7: 384, 9: 256, 11: 256}}
MODELS = {"vgg": torchvision.models.vgg16, "squeeze": torchvision.models.squeezenet1_1,
          "alex": torchvision.models.alexnet}
MEAN = torch.tensor([0.485, 0.456, 0.406], dtype=torch.double).view(3, 1, 1)
DEVIATION = torch.tensor([0.229, 0.224, 0.225], dtype=torch.double).view(3, 1, 1)


def make_weights(name, linear):
    torch.manual_seed(1)
    network = MODELS[name](weights=None).features[:max(TAPS[name]) + 1]
    for layer in network.modules():
        if isinstance(layer, torch.nn.Conv2d):
            torch.nn.init.kaiming_uniform_(layer.weight, nonlinearity="relu")
            torch.nn.init.uniform_(layer.bias, -0.05, 0.05)
        if isinstance(layer, torch.nn.ReLU):
            layer.inplace = False
    channel_weights = [torch.rand(n) if linear else torch.full((n,), 1 / n)
                       for n in TAPS[name].values()]
    tensors = {f"features.{key}": values for key, values in network.state_dict().items()}
    if linear:
        for tap, values in enumerate(channel_weights):
            tensors[f"lin{tap}.model.1.weight"] = values.view(1, -1, 1, 1).contiguous()
    return network.double(), channel_weights, tensors


def lpips(network, taps, channel_weights, rendered, ground_truth):
    """LPIPS as published: features of the taps, scaled to unit length at each pixel."""
    loss = 0
    a, b = ((image - MEAN.to(image)) / DEVIATION.to(image) for image in (rendered, ground_truth))
    a, b = a[None], b[None]
    weights_of_taps = iter(channel_weights)
    for number, layer in enumerate(network):
        a, b = layer(a), layer(b)
        if number in taps:
            unit_a, unit_b = (x / torch.sqrt((x ** 2).sum(1, keepdim=True) + 1e-10)
                              for x in (a, b))
            weights = next(weights_of_taps).to(a).view(1, -1, 1, 1)
            loss = loss + (weights * (unit_a - unit_b) ** 2).sum(1).mean()
    return loss


def pytorch_loss(network, taps, channel_weights, rendered, ground_truth, dtype):
    """Returns PyTorch's loss and its gradient with respect to the rendered image."""
    device = next(network.parameters()).device
    x = rendered.to(device, dtype).requires_grad_()
    y = ground_truth.permute(2, 0, 1).to(device, dtype) / 255
    loss = lpips(network, taps, channel_weights, x, y)
    loss.backward()
    return loss.item(), x.grad.double().cpu()


def stgs_loss(probe, backend, weights, rendered, ground_truth, folder):
    """Returns the loss and the gradient that STGS computes."""
    files = [os.path.join(folder, name) for name in ("rendered", "ground_truth", "gradient")]
    rendered.numpy().tofile(files[0])
    ground_truth.numpy().tofile(files[1])
    height, width = ground_truth.shape[:2]
    printed = subprocess.run([probe, weights, str(width), str(height), *files, backend],
                             stdout=subprocess.PIPE, check=True).stdout
    with open(files[2], "rb") as file:
        gradient = torch.frombuffer(bytearray(file.read()), dtype=torch.float32)
    return float(printed), gradient.view(3, height, width).double()


def compare(kind, linear, probe, names, device, folder):
    """Prints the errors for a network; returns, for each name, those of losses and gradients."""
    errors = {name: ([], []) for name in names}
    network, channel_weights, tensors = make_weights(kind, linear)
    network = network.to(device)
    weights = os.path.join(folder, "weights.safetensors")
    save_file(tensors, weights)
    for width, height, noise in ((96, 64, 0.3), (131, 77, 0.1), (256, 256, 0.03)) * 2:
        ground_truth = (torch.rand(height, width, 3) * 255).to(torch.uint8)
        exact = (ground_truth.permute(2, 0, 1).float() / 255).contiguous()
        rendered = exact + noise * torch.randn(3, height, width)
        loss, gradient = pytorch_loss(network, TAPS[kind], channel_weights, rendered, ground_truth,
                                      torch.double)
        for name, (loss_errors, gradient_errors) in errors.items():
            if name == "pytorch-tf32":
                found = pytorch_loss(copy.deepcopy(network).float(), TAPS[kind], channel_weights,
                                     rendered, ground_truth, torch.float)
            else:
                found = stgs_loss(probe, name, weights, rendered, ground_truth, folder)
            loss_errors.append(abs(found[0] / loss - 1))
            gradient_errors.append(((found[1] - gradient).norm() / gradient.norm()).item())
        print(f"{kind}, {width}x{height}, noise {noise:.2f}, {'linear' if linear else 'uniform'}, "
              f"loss {loss:.6f}: " + ", ".join(f"{name} {e[0][-1]:.1e} {e[1][-1]:.1e}"
                                               for name, e in errors.items()), flush=True)
    return errors


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    probe, names = sys.argv[1], sys.argv[2:] or ["cpu"]
    device = "cuda" if torch.cuda.is_available() else "cpu"
    torch.backends.cudnn.allow_tf32 = True
    if device == "cuda":
        names.append("pytorch-tf32")  # for comparison
    failed = False
    with tempfile.TemporaryDirectory() as folder:
        for kind, linear in (("vgg", False), ("vgg", True), ("squeeze", True), ("alex", True)):
            errors = compare(kind, linear, probe, names, device, folder)
            for name, (loss_errors, gradient_errors) in errors.items():
                found = (max(loss_errors), statistics.median(gradient_errors),
                         max(gradient_errors))
                bounds = BOUNDS[kind].get(name, found)
                within = all(e <= bound for e, bound in zip(found, bounds))
                failed |= not within
                print("{}, {}: relative error of the loss {:.1e}, largest; of the gradient {:.1e}, "
                      "median, and {:.1e}, largest{}".format(kind, name, *found,
                                                             "" if within else ": TOO LARGE"))
    sys.exit(failed)


if __name__ == "__main__":
    main()
