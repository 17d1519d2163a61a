//! The decoder of a turning object: sense and centre of the rotation.

use paig::physics_models::{ModelOptions, PhysicsNet};
use paig::tasks::find;
use tch::{Device, Kind, Tensor};

#[test]
fn sprites_turn_clockwise_about_the_middle() {
    let model = PhysicsNet::new(find("pendulum").unwrap(), &ModelOptions::original(), Device::Cpu, 3);
    let _guard = tch::no_grad_guard();
    // A bump makes the sprite visible; its colours vary smoothly from the top left to the bottom right.
    model.decoder.start_templates(3.0, 0.3);
    let slope = Tensor::linspace(-1.0, 1.0, 32, (Kind::Float, Device::Cpu));
    let colours = (slope.unsqueeze(1) + slope.unsqueeze(0) * 2.0).unsqueeze(-1).repeat([1, 1, 3]).flatten(0, -1);
    for (name, mut variable) in model.named_variables() {
        if name.ends_with("bias") && variable.size() == colours.size() {
            variable.copy_(&colours);
        }
    }
    let quarter = std::f32::consts::FRAC_PI_2;
    let drawn = model.decoder.forward(&Tensor::from_slice(&[0.0, quarter, 2.0 * quarter, -quarter]).unsqueeze(1));
    let objects = (drawn.masks.select(0, 0).unsqueeze(1) * drawn.contents.select(0, 0)).to_kind(Kind::Double);
    let upright = objects.narrow(0, 0, 1);
    let spread = (&upright - upright.rot90(2, [2, 3])).abs().max().double_value(&[]);
    assert!(spread > 0.1, "the sprite looks the same upside down: the test would show nothing");
    for (place, turns) in [(1, -1), (2, 2), (3, 1)] {
        // rot90 turns anticlockwise on the screen. The transformer's grid is half a hundredth of a pixel off its middle
        // (size - 1.01), which moves colours by some thousandths.
        let expected = upright.rot90(turns, [2, 3]);
        let error = (objects.narrow(0, place, 1) - expected).abs().max().double_value(&[]);
        assert!(error < 0.02, "turned by {turns} quarters: off by {error}");
    }
}
