// What pipeline/report/assets/three.min.js holds. To make it again, keep the comment at its head:
//
//     npm install --no-save three@0.187.0 esbuild@0.28.2
//     npx esbuild scripts/dev/three_entry.js --bundle --minify --format=iife --global-name=THREE --target=es2020 \
//         --legal-comments=none --outfile=three.min.js
export {
    BufferAttribute, BufferGeometry, DirectionalLight, DoubleSide, Float32BufferAttribute, HemisphereLight,
    LineBasicMaterial, LineSegments, Matrix4, Mesh, MeshBasicMaterial, MeshLambertMaterial, PerspectiveCamera, Points,
    PointsMaterial, Scene, SRGBColorSpace, Texture, Vector3, WebGLRenderer,
} from "three";
export { OrbitControls } from "three/addons/controls/OrbitControls.js";
