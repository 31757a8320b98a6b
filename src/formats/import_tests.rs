use super::*;
#[test]
fn try_models() {
    for name in ["bunny.obj", "Fox.glb", "SimpleSkin.gltf", "liver-smooth.obj", "malleus.obj"] {
        let start = std::time::Instant::now();
        let model = load(&format!("/work/shared/models/{name}")).unwrap();
        let took = start.elapsed();
        model.rig.validate().unwrap();
        println!("{name} {took:?} {}", serde_json::to_string(&inspect(&model, &model.rig.rest_pose())).unwrap());
    }
}
